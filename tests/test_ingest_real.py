"""Recordings of other laboratories, read untouched by a setup alone (skipped without ../shared)."""

import time
from pathlib import Path

import numpy as np
import pytest

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest import load
from mtpipe.setup.setup import read_setup
from tests.ingest_recordings import codes

ROOT = Path(__file__).parents[1]
RECORDINGS = ROOT.parent / "shared" / "recordings"
SETUPS = ROOT / "tests" / "data" / "real_setups"

pytestmark = pytest.mark.skipif(
    not RECORDINGS.is_dir(), reason="../shared/recordings is not beside this checkout"
)


def read(where, name):
    return load(RECORDINGS / where, SETUPS / f"{name}.toml")


@pytest.mark.slow
def test_cmaddry_run2_complete():
    started = time.monotonic()
    recording = read("cmaddry-run2", "cmaddry-run2")
    assert time.monotonic() - started < 20
    assert len(recording.time_s) == 407_774
    assert len(recording.files) == 102
    assert recording.references == ("ref1", "ref2")
    assert recording.tethered == ("b1", "b2", "b3", "b4")
    assert np.isnan(recording.positions_nm["b1"][:400]).all()
    # 1.3 % are blocks that stand 256 rows earlier too: copies, which are lost
    (copies,) = [notice for notice in recording.notices if notice.code == "repeated_rows"]
    assert "those of 256 rows before" in copies.message
    assert 0.985 < np.isfinite(recording.positions_nm["b1"][400:]).mean() < 0.99
    # columns and units: pair of stuck beads, first row of numbers
    difference = recording.positions_nm["ref1"] - recording.positions_nm["ref2"]
    assert np.nanstd(np.diff(difference[180_000:190_000], axis=0)) < 5
    assert recording.positions_nm["ref1"][400, 0] == pytest.approx(1651.5 * 64.6, rel=1e-4)
    # plateaus: the owners' row ranges lie within, none where the magnets rotate
    spans = {(p.start, p.stop): p.magnet_mm for p in recording.plateaus}

    def motor(first, last):
        (value,) = [v for (a, b), v in spans.items() if a <= first and last <= b]
        return value

    assert motor(145_000, 168_000) == pytest.approx(11.7, abs=1e-3)
    assert motor(138_000, 140_000) == pytest.approx(21.7, abs=1e-3)
    assert motor(500, 103_000) == pytest.approx(21.7, abs=1e-3)
    staircase = [v for (a, b), v in spans.items() if a >= 190_000 and b <= 254_000]
    assert len(staircase) == 31
    assert np.all(np.diff(staircase) < -0.2)
    assert not [1 for a, b in spans if a < 283_000 and b > 271_000]
    # z = 0: extension grows up the staircase to that of a tether of a micrometre or so
    stage = np.mean([recording.positions_nm[r][:, 2] for r in recording.references], axis=0)
    for bead, low, high in (("b1", 1300, 1550), ("b2", 1450, 1800), ("b4", 1550, 1850)):
        z = recording.positions_nm[bead][:, 2] - stage + np.nanmedian(stage[400:800])
        assert low < np.nanmedian(z[175_000:190_000]) < high
        assert 100 < np.nanmedian(z[251_600:253_500]) < 500


def test_softmatterlab_water():
    recording = read("softmatterlab-water", "softmatterlab-water")
    assert len(recording.time_s) == 29_999
    assert recording.setup.camera.frame_rate_hz.value == pytest.approx(145.0, abs=0.01)
    assert np.all(np.diff(recording.frame) == 1)
    x = recording.positions_nm["b1"][:, 0]
    assert x[0] == pytest.approx(-38.101)
    assert 15 < np.std(x) < 60
    assert {"frame_rate_derived", "no_magnet", "no_axis"} <= codes(recording)


@pytest.mark.parametrize(
    ("name", "rows"),
    [("bead1_cal", 16_440), ("bead2_cal", 16_440), ("bead1_trj", 27_000), ("bead2_trj", 27_000)],
)
def test_vbtpm(name, rows):
    recording = read(f"vbtpm/{name}.mat", "vbtpm")
    assert len(recording.time_s) == rows
    xyz = recording.positions_nm["b1"]
    assert np.all((np.std(xyz[:, :2], axis=0) > 90) & (np.std(xyz[:, :2], axis=0) < 130))
    assert np.isnan(xyz[:, 2]).all()


@pytest.mark.slow
def test_picotwist_ramps():
    recording = read("picotwist", "picotwist")
    assert len(recording.positions_nm) == 74
    assert recording.frame[0] == 817
    assert {round(p.magnet_mm, 3) for p in recording.plateaus} <= {-0.698, -0.699, -0.198}
    # hairpins: on the surface where the magnets are far, micrometres above it where they are near
    near = [p for p in recording.plateaus if p.magnet_mm > -0.3]
    far = [p for p in recording.plateaus if p.magnet_mm < -0.6]
    assert len(near) >= 10
    assert len(far) >= 10
    z = recording.positions_nm["bead010"][:, 2]
    assert abs(np.median(z[far[1].start : far[1].stop])) < 20
    assert np.median(z[near[1].start : near[1].stop]) > 3000


def test_picotwist_plot_file():
    recording = read("picotwist/grfile.gr", "picotwist-gr")
    z = recording.positions_nm["bead0"][:, 2]
    assert len(z) == 44_821
    assert 800 < np.max(z) < 1500
    assert np.count_nonzero(np.diff(recording.frame) > 1) == 99


def test_vannoort_labview_traces():
    recording = read("vannoort-stacks/data_024.tdms", "vannoort-tdms")
    assert len(recording.positions_nm) == 16
    assert recording.setup.camera.frame_rate_hz.value == pytest.approx(25.3, abs=0.01)
    assert recording.positions_nm["bead0"][0, 1] == pytest.approx(1017934.5, abs=0.1)
    assert "z_zero_unknown" in codes(recording)


def test_vannoort_placeholders_are_refused():
    with pytest.raises(RecordingError, match=r"never moves.*placeholder"):
        read("vannoort-stacks/data_153.hdf", "vannoort-hdf")


@pytest.mark.parametrize(
    ("where", "why"),
    [
        ("vannoort-stacks/data_153.bin", "no table|binary|columns"),
        ("qtrk-images/j_beadimg.png", "image"),
        ("dollsimon-psd/2017-01-13_16-32-24 FUSpolyN 012-000.h5", "HDF5"),
        ("dollsimon-psd/PSD_34.txt.gz", "no column time_s"),
    ],
)
def test_what_holds_no_traces_is_refused(where, why):
    """Images have no traces yet; the optical trap's text files are spectra, not positions."""
    setup = read_setup(SETUPS / "vbtpm.toml").model_copy(update={"source": None})
    with pytest.raises(RecordingError, match=why):
        load(RECORDINGS / where, setup)
