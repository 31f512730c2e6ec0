"""z = 0 from the edge of a distribution, and where it is put."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest import load
from mtpipe.ingest.edge import largest_noise_nm, lower_edge_nm
from mtpipe.ingest.surface import put_surface_at_zero
from mtpipe.recording.recording import Drift
from tests.ingest_recordings import RATE, codes, setup_of

NOISE_NM = 5.0


def correlated_uniform(n, frames, rng):
    """Uniform on (0, 1) with a correlation time in frames."""
    r = np.exp(-1 / frames)
    return norm.cdf(lfilter([np.sqrt(1 - r * r)], [1, -r], rng.normal(size=n)))


HEIGHTS = {
    "at rest": lambda u: 0 * u,
    "barometric, 10 nm": lambda u: -10 * np.log(1 - u),
    "barometric, 300 nm": lambda u: -300 * np.log(1 - u),
    "half normal": lambda u: 100 * norm.ppf((1 + u) / 2),
    "kept away (ramp)": lambda u: 150 * np.sqrt(-2 * np.log(1 - u)),
    "half the time at rest": lambda u: np.maximum(0, 100 * norm.ppf(u)),
}


@pytest.mark.parametrize("law", HEIGHTS)
@pytest.mark.parametrize("n", [3000, 30000])
def test_the_edge_is_found_whatever_the_law_and_however_long(law, n):
    rng = np.random.default_rng(5)
    errors = []
    for _ in range(3):
        z = HEIGHTS[law](correlated_uniform(n, 30, rng)) + rng.normal(0, NOISE_NM, n) + 7000
        errors.append(lower_edge_nm(z)[0] - 7000)
    allowed = 30.0 if law.startswith("kept") and n == 3000 else NOISE_NM
    assert abs(np.median(errors)) < allowed


def test_the_minimum_would_depend_on_the_length_and_the_edge_does_not():
    rng = np.random.default_rng(0)
    z = HEIGHTS["barometric, 300 nm"](correlated_uniform(60000, 10, rng)) + rng.normal(0, 20, 60000)
    short, long = z[:3000], z
    assert long.min() < short.min() - 15
    assert abs(lower_edge_nm(long)[0] - lower_edge_nm(short)[0]) < 10
    assert abs(lower_edge_nm(long)[0]) < 5


def test_mistracked_values_do_not_move_the_edge():
    rng = np.random.default_rng(0)
    z = HEIGHTS["half normal"](correlated_uniform(5000, 20, rng)) + rng.normal(0, 5, 5000)
    clean = lower_edge_nm(z)[0]
    z[::500] = -80000.0
    z[7::500] = np.nan
    assert lower_edge_nm(z)[0] == pytest.approx(clean, abs=3)


def test_largest_noise_is_the_noise_of_a_diffusing_bead():
    rng = np.random.default_rng(0)
    z = np.cumsum(rng.normal(0, 20, 20000)) + rng.normal(0, 8, 20000)
    assert largest_noise_nm(z) == pytest.approx(8, rel=0.1)


def test_too_few_values_are_refused():
    with pytest.raises(ValueError, match="40 values are too few"):
        lower_edge_nm(np.where(np.arange(100) < 40, 0.0, np.nan))


def lab_file(tmp_path, n=6000):
    """b1 touches a surface at 9000 nm in rows 1001 to 3000 while the stage drifts by 500 nm."""
    rng = np.random.default_rng(3)
    drift = np.linspace(0, 500, n)
    height = np.full(n, 800.0) + rng.normal(0, 10, n)
    height[1000:3000] = HEIGHTS["half normal"](correlated_uniform(2000, 20, rng))
    path = tmp_path / "t.npz"
    np.savez(
        path,
        x=rng.normal(0, 30, n),
        z=9000 + height + drift + rng.normal(0, 3, n),
        ref_z=4000 + drift + rng.normal(0, 1, n),
    )
    beads = [{"name": "b1", "x": "x", "z": "z"}, {"name": "ref1", "z": "ref_z"}]
    return path, {"beads": beads, "units": {"position": "nm"}}


@pytest.mark.parametrize("stretch", [{"touch_rows": [1001, 3000]}, {"touch_time_s": [10.0, 30.0]}])
def test_a_touching_stretch_puts_zero_at_the_surface_after_drift(tmp_path, stretch):
    path, source = lab_file(tmp_path)
    recording = load(path, setup_of({**source, "z_zero": stretch}))
    assert "z_zero_from_touch" in codes(recording)
    drift = np.zeros((6000, 3))
    drift[:, 2] = np.linspace(0, 500, 6000)
    z = recording.positions_nm["b1"][:, 2] - drift[:, 2]
    assert np.median(z[4000:]) == pytest.approx(800, abs=8)

    # after the drift is taken off for good, from another beginning, it is found again
    b1 = recording.positions_nm["b1"] - drift + [0, 0, 60]
    zero = (0.0, 0.0, 0.0)
    subtracted = dataclasses.replace(
        recording,
        positions_nm={**recording.positions_nm, "b1": b1},
        drift=Drift("reference", (None, None, None), (), drift, zero, zero, zero),
    )
    again = put_surface_at_zero(subtracted)
    assert np.median(again.positions_nm["b1"][4000:, 2]) == pytest.approx(800, abs=8)


def test_a_rest_on_the_surface_is_no_plateau(tmp_path):
    path, source = lab_file(tmp_path)
    magnet = np.repeat([5.0, 9.0, 5.0, 3.0], [1000, 2000, 1500, 1500])
    np.savez(path, **np.load(path), magnet=magnet)
    source |= {"magnet": {"column": "magnet", "unit": "mm"}}

    def down(rows, **beside):
        return {**source, "z_zero": {"touch_rows": rows, "no_plateau": True} | beside}

    whole = load(path, setup_of(down([1101, 2900], no_plateau=False)))
    assert [one.magnet_mm for one in whole.plateaus] == [5.0, 9.0, 5.0, 3.0]
    touched = load(path, setup_of(down([1101, 2900])))
    assert [one.magnet_mm for one in touched.plateaus] == [5.0, 5.0, 3.0]
    assert [one.number for one in touched.plateaus] == [0, 1, 2]
    assert "touching_left_out" in codes(touched)
    # a stretch that is a small part of a plateau leaves it
    part = load(path, setup_of(down([1101, 1700])))
    assert len(part.plateaus) == 4


def test_a_stretch_counts_rows_before_any_is_left_out(tmp_path):
    path, source = lab_file(tmp_path)
    source |= {"skip_rows": [[1, 500]], "z_zero": {"touch_rows": [1001, 3000]}}
    recording = load(path, setup_of(source))
    stage = np.linspace(0, 500, 6000)[500:] - 500 * 500 / 6000
    z = recording.positions_nm["b1"][:, 2] - stage
    assert len(recording.time_s) == 5500
    assert np.median(z[4000:]) == pytest.approx(800, abs=8)
    source["z_zero"] = {"touch_time_s": [1000.0, 1010.0]}
    with pytest.raises(RecordingError, match="not in the recording"):
        load(path, setup_of(source))
    source["z_zero"] = {"touch_rows": [1001, 1030]}
    with pytest.raises(RecordingError, match="30 values are too few"):
        load(path, setup_of(source))


def test_a_value_or_none(tmp_path):
    path, source = lab_file(tmp_path)
    raw = load(path, setup_of({**source, "z_zero": {"unknown": True}}))
    shifted = load(path, setup_of({**source, "z_zero_of": {"b1": {"value_nm": 9000.0}}}))
    np.testing.assert_allclose(
        raw.positions_nm["b1"][:, 2] - shifted.positions_nm["b1"][:, 2], 9000.0
    )
    (said,) = [n for n in raw.notices if n.code == "z_zero_unknown"]
    assert "there is neither an extension nor a force" in said.message
    assert "z_zero_unknown" not in codes(shifted)
    assert raw.time_s[-1] == pytest.approx(5999 / RATE)
    assert put_surface_at_zero(raw).positions_nm["b1"] is raw.positions_nm["b1"]
