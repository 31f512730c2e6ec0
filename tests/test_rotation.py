"""Nicked, supercoilable or several tethers: told by turning the magnets."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import mtpipe
from mtpipe.curves.rotation.beads import turning
from mtpipe.curves.rotation.kinds import KINDS, Known
from mtpipe.curves.rotation.turned import turned_stretches
from mtpipe.curves.rotation.verdict import CANNOT_TELL, verdict_of
from mtpipe.drift import subtract_drift
from mtpipe.ground.processes import executor
from mtpipe.ground.steps import finished
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.turned_tethers import (
    shortened_by_braiding_nm,
    shortened_by_coiling_nm,
    supercoiling,
)
from mtpipe.setup.conditions import conditions_of
from mtpipe.setup.setup import parse_setup

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
REAL = ROOT.parent / "shared" / "recordings" / "cmaddry-run1"
KT = float(thermal_energy_pN_nm(298.15))
CONTOUR_NM = 2700.0


@pytest.fixture(scope="module")
def simulated():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "workflows" / "rotation"))
        import simulated

        yield simulated


def known(force_pN):
    return Known(force_pN, 0.1, CONTOUR_NM, 0.05, 50.0, KT, 500.0)


def test_a_molecule_buckles_as_theory_has_it():
    """Numbers of Marko 2007 by hand at 1 pN, and its continuity at buckling and at full coiling."""
    found = supercoiling(1.0, CONTOUR_NM, 50.0, KT)
    twist = 2 * np.pi / 3.57
    softening = np.sqrt(KT / 50.0)
    stretched = KT * 100 * twist**2 * (1 - 0.5 * softening)
    plectoneme = KT * 24 * twist**2
    torque = np.sqrt(2 * plectoneme * (1 - softening) / (1 - plectoneme / stretched)) / twist
    assert found.torque_pN_nm == pytest.approx(torque, rel=1e-12)
    assert found.buckling_turns == pytest.approx(
        torque * twist / stretched * CONTOUR_NM / 3.57, rel=1e-12
    )
    # slope times turns until all is plectoneme is the whole extension
    last = torque * twist / plectoneme * CONTOUR_NM / 3.57
    length = CONTOUR_NM * (1 - softening / 2) - found.sag_nm
    assert found.slope_nm * (last - found.buckling_turns) == pytest.approx(length)
    lost = shortened_by_coiling_nm(np.array([-last, 0.0, last]), found)
    np.testing.assert_allclose(lost, [length + found.sag_nm, 0.0, length + found.sag_nm])
    more = supercoiling(2.0, CONTOUR_NM, 50.0, KT)
    assert more.buckling_turns > found.buckling_turns
    assert more.slope_nm < found.slope_nm
    for least in (1e-6, KT / 50.0):  # where the expansion ends all stays finite
        assert np.isfinite(supercoiling(least, CONTOUR_NM, 50.0, KT).slope_nm)
    assert np.isfinite(supercoiling(1.0, CONTOUR_NM, 0.7, KT).slope_nm)  # and of what is no DNA


def test_two_molecules_cross_after_half_a_turn():
    turns = np.array([-3.0, -0.5, 0.0, 0.5, 3.0])
    lost = shortened_by_braiding_nm(turns, 1.0, 2400.0, 400.0, 50.0, KT)
    assert lost[1] == lost[3] == pytest.approx(2400 - np.sqrt(2400**2 - 400**2))
    assert lost[2] == 0
    assert lost[0] == lost[4] > 1.5 * lost[3]


@pytest.mark.parametrize("force_pN", [0.3, 1.2])
@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_is_told_by_its_curve(simulated, kind, force_pN):
    random = np.random.default_rng(7)
    recording = simulated.recording({"b": kind}, force_pN, CONTOUR_NM, random)
    (turned,) = turned_stretches(recording)
    found = verdict_of(turned, known(force_pN))
    assert found.verdict == kind
    assert sum(found.probability.values()) == pytest.approx(1)
    if kind == "supercoilable":
        true = supercoiling(force_pN, CONTOUR_NM, 50.0, KT).buckling_turns
        assert found.buckling_turns == pytest.approx(true, rel=0.25)
        assert 0 < found.buckling_stderr < 0.3 * true
        if force_pN < 0.6:  # else only one side falls, and does not tell where the middle is
            assert abs(found.relaxed_turns) < 3


def test_what_turns_cannot_tell_is_left_open(simulated):
    random = np.random.default_rng(3)
    few = simulated.recording({"b": "nicked"}, 1.2, CONTOUR_NM, random, low=-5, high=5)
    high = simulated.recording({"b": "nicked"}, 5.0, CONTOUR_NM, random)
    for recording, force_pN, why in ((few, 1.2, "so few turns"), (high, 5.0, "at such a force")):
        found = verdict_of(next(turned_stretches(recording)), known(force_pN))
        assert found.verdict == CANNOT_TELL
        assert why in found.reason
        assert found.probability["several tethers"] < 0.05
    # turns that nobody logged, and turns that are too few, are no curve
    assert not list(
        turned_stretches(simulated.recording({"b": "nicked"}, 1, 2700, random, high=1, low=0))
    )


def test_noise_alone_is_no_kind(simulated):
    random = np.random.default_rng(5)
    recording = simulated.recording({"b": "nicked"}, 1.2, CONTOUR_NM, random)
    turned = next(turned_stretches(recording))
    jumping = turned.extension_nm + 900 * random.normal(size=len(turned.turns))
    wild = type(turned)("b", 2.0, 0.0, 1.0, turned.turns, jumping)
    found = verdict_of(wild, known(1.2))
    assert found.verdict == CANNOT_TELL
    assert "scatters" in found.reason


def test_a_run_writes_what_turning_says(simulated, tmp_path):
    raw = simulated.recording({"b": "supercoilable"}, 1.2, 2700.0, np.random.default_rng(1))
    table = {"time_s": raw.time_s, "magnet_mm": raw.magnet_mm, "magnet_turns": raw.magnet_turns}
    table |= {f"b_{axis}_nm": raw.positions_nm["b"][:, n] for n, axis in enumerate("xyz")}
    pd.DataFrame(table).to_csv(tmp_path / "recording.csv", index=False)
    lines = ["schema = 1"]
    for name, content in simulated.setup_content(2700.0).items():
        if name != "schema":
            lines += [f"[{name}]", *(f"{k} = {json.dumps(v)}" for k, v in content.items())]
    (tmp_path / "setup.toml").write_text("\n".join(lines))
    read = mtpipe.load(tmp_path / "recording.csv")
    np.testing.assert_allclose(read.magnet_turns, raw.magnet_turns)
    (rest,) = read.plateaus  # there is none while the magnets rotate
    assert rest.start == 0
    assert 470 < rest.stop < 500
    out = tmp_path / "out"
    run = mtpipe.run(tmp_path / "recording.csv", out, cross_check=False)
    row = pd.read_csv(out / "rotation.csv").iloc[0]
    assert (row.bead, row.magnet_mm) == ("b", 2.0)
    assert row.verdict == run.turned[0].verdict.verdict
    assert row[["p_nicked", "p_supercoilable", "p_several_tethers"]].sum() == pytest.approx(1)
    assert "turns of the magnets" in (out / "rotation.html").read_text()
    (notice,) = [one for one in run.notices if one.code == "turned"]
    assert notice.bead == "b"
    assert "held by one supercoilable molecule" in notice.message
    assert "It buckles after" in notice.message
    # a run without turns leaves none of an earlier one
    pd.DataFrame(table).drop(columns="magnet_turns").to_csv(tmp_path / "recording.csv", index=False)
    mtpipe.run(tmp_path / "recording.csv", out, cross_check=False)
    assert not (out / "rotation.csv").exists()


@pytest.mark.skipif(not REAL.is_dir(), reason="../shared/recordings is not beside this checkout")
def test_a_real_bead_on_two_tethers_is_told_from_those_that_turns_leave_alone():
    content = tomllib.loads((ROOT / "tests/data/real_setups/cmaddry-run2.toml").read_text())
    content["source"]["z_zero"] = {"touch_rows": [104601, 109100]}
    recording = subtract_drift(mtpipe.load(REAL, parse_setup(content)))
    with executor(1) as pool:
        beads = finished(turning(recording, {}, conditions_of(recording.setup)[0], pool))
    verdicts = {one.turned.bead: one.verdict.verdict for one in beads}
    assert verdicts == dict.fromkeys(("b1", "b3", "b4"), CANNOT_TELL) | {"b2": "several tethers"}
