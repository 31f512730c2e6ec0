"""What is wrong with a recording is refused or remarked on, each in its own words."""

import numpy as np
import pytest

from mtpipe.ground.errors import RecordingError, SetupError
from mtpipe.ingest import load
from tests.ingest_recordings import RATE, canonical_lines, codes, motion, setup_of, write


def read(tmp_path, positions, setup=None, **kwargs):
    lines = canonical_lines(positions, **kwargs)
    return load(write(tmp_path / "recording.csv", lines), setup or setup_of())


def test_a_good_recording_has_no_warning(tmp_path):
    recording = read(tmp_path, motion(500), magnet=[2.0] * 500)
    assert recording.notices == ()
    assert (recording.references, recording.tethered) == (("ref1",), ("b1",))


def test_a_bead_that_never_moves_is_left_out_and_named(tmp_path):
    positions = motion(400, beads=("b1", "b2", "ref1"))
    positions["b2"][:, :2] = 77.0
    recording = read(tmp_path, positions)
    assert recording.tethered == ("b1",)
    (said,) = [n for n in recording.notices if n.code == "constant_bead"]
    assert said.bead == "b2"
    positions["b1"][:] = 0.0
    with pytest.raises(RecordingError, match=r"no tethered bead is left.*never moves"):
        read(tmp_path, positions)


def test_a_constant_axis_counts_as_not_recorded(tmp_path):
    positions = motion(400)
    positions["b1"][:, 2] = 5.0
    recording = read(tmp_path, positions)
    assert np.isnan(recording.positions_nm["b1"][:, 2]).all()
    assert "constant_column" in codes(recording)


@pytest.mark.parametrize(("factor", "what"), [(1000.0, "wanders over"), (1e-3, "moves by only"),
                                              (1e-9, "moves by only")])  # fmt: skip
def test_a_wrong_unit_is_an_error(tmp_path, factor, what):
    positions = {bead: p * factor for bead, p in motion(400).items()}
    with pytest.raises(RecordingError, match=what):
        read(tmp_path, positions)


def test_one_bead_that_wanders_loses_no_other(tmp_path):
    positions = motion(400, beads=("b1", "b2", "ref1"))
    positions["b2"][:, 0] += np.linspace(0, 30000, 400)
    recording = read(tmp_path, positions)
    assert recording.tethered == ("b1", "b2")
    assert [n.bead for n in recording.notices if n.code == "unit"] == ["b2"]


def test_a_frame_rate_that_contradicts_the_stamps_is_an_error(tmp_path):
    with pytest.raises(RecordingError, match=r"setup says 101 .*time stamps say 100"):
        read(tmp_path, motion(400), setup_of(rate=101.0))
    read(tmp_path, motion(400), setup_of(rate=100.4))


def test_an_unknown_frame_rate_is_taken_from_the_stamps(tmp_path):
    recording = read(tmp_path, motion(400), setup_of(rate="unknown"))
    assert recording.setup.camera.frame_rate_hz.value == pytest.approx(RATE, rel=1e-9)
    assert "frame_rate_derived" in codes(recording)
    lines = canonical_lines(motion(400), time=[str(i) for i in range(400)])
    lines[0] = lines[0].replace("time_s", "frame")
    with pytest.raises(RecordingError, match="frame rate is unknown"):
        load(write(tmp_path / "f.csv", lines), setup_of(rate="unknown"))


def test_an_exposure_longer_than_the_derived_frame_is_an_error(tmp_path):
    setup = setup_of(rate="unknown")
    exposure = setup.camera.exposure_s.model_copy(update={"value": 0.02})
    camera = setup.camera.model_copy(update={"exposure_s": exposure})
    with pytest.raises(SetupError, match="longer than a frame"):
        read(tmp_path, motion(400), setup.model_copy(update={"camera": camera}))


def test_irregular_stamps_are_remarked_on(tmp_path):
    rng = np.random.default_rng(0)
    time = np.arange(400) / RATE + rng.uniform(-0.3, 0.3, 400) / RATE
    recording = read(tmp_path, motion(400), time=[f"{t:.6f}" for t in time])
    assert "irregular_stamps" in codes(recording)
    assert recording.frame[-1] == 399


def test_a_late_stamp_is_no_lost_frame_and_a_gap_is(tmp_path):
    time = np.arange(400) / RATE
    time[200:204] = time[204] - np.array([4, 3, 2, 1]) * 1e-4  # late, then catching up
    time[300:] += 7 / RATE
    recording = read(tmp_path, motion(400), time=[f"{t:.6f}" for t in time])
    assert recording.frame[299:301].tolist() == [299, 307]
    assert recording.frame[-1] == 406


def test_a_missing_reference_names_those_present(tmp_path):
    with pytest.raises(SetupError, match=r"'ref2' is not in the recording") as caught:
        read(tmp_path, motion(400), setup_of(reference=("ref2",)))
    assert "b1, ref1" in caught.value.mend
    with pytest.raises(RecordingError, match="none is tethered"):
        read(tmp_path, motion(400), setup_of(reference=("ref1", "b1")))


def test_a_reference_that_moves_is_named(tmp_path):
    positions = motion(1000, beads=("b1", "ref1"))
    assert "moving_reference" not in codes(read(tmp_path, positions))
    rng = np.random.default_rng(2)
    positions["ref1"][:, 1] += rng.normal(0, 25, 1000)
    recording = read(tmp_path, positions)
    assert [n.bead for n in recording.notices if n.code == "moving_reference"] == ["ref1"]


def test_lost_frames_are_counted_and_weighed(tmp_path):
    positions = motion(1000)
    positions["b1"][:20] = np.nan
    recording = read(tmp_path, positions)
    (said,) = [n for n in recording.notices if n.code == "lost_frames"]
    assert (said.bead, said.severity) == ("b1", "info")
    assert "2 %" in said.message
    positions["b1"][:600] = np.nan
    (said,) = [n for n in read(tmp_path, positions).notices if n.code == "lost_frames"]
    assert said.severity == "warning"
    positions["ref1"][:] = np.nan
    recording = read(tmp_path, positions)
    assert recording.references == ()
    assert "no_positions" in codes(recording)


def test_no_plateau_says_what_to_change(tmp_path):
    with pytest.raises(RecordingError, match=r"lasts 3\.99 s, a plateau at least 5 s"):
        read(tmp_path, motion(400), setup_of(minimum_s=5.0))
    rng = np.random.default_rng(0)
    magnet = np.round(2 + rng.normal(0, 1e-3, 400), 5)
    with pytest.raises(RecordingError, match="no stretch of resting magnets") as caught:
        read(tmp_path, motion(400), magnet=magnet)
    assert "tolerance_mm" in caught.value.mend
    recording = read(tmp_path, motion(400), setup_of(tolerance_mm=0.01), magnet=magnet)
    assert len(recording.plateaus) == 1
    # every second cell empty: no motor moves by nought
    half = ["2.0" if i % 2 else "" for i in range(400)]
    missing = "missing in 200 of 400 frames, and without a break it is there for at most 0.01 s"
    with pytest.raises(RecordingError, match=missing) as caught:
        read(tmp_path, motion(400), magnet=half)
    assert "0 mm" not in str(caught.value)
    assert "empty cells" in caught.value.mend
    steps = np.repeat([2.0, 3.0, 4.0, 5.0, 6.0], [50, 100, 100, 100, 50])
    with pytest.raises(RecordingError, match=r"the longest lasts 1 s, of which 0\.2 s are left"):
        read(tmp_path, motion(400), setup_of(settle_s=0.2, minimum_s=1.0), magnet=steps)


def test_blocks_that_were_written_twice_are_told(tmp_path):
    positions = motion(600, beads=("b1", "b2", "ref1"))
    positions["b2"][300:350] = positions["b2"][200:250]
    positions["b2"][400:410] = positions["b2"][300:310]
    recording = read(tmp_path, positions)
    (said,) = [n for n in recording.notices if n.code == "repeated_rows"]
    assert said.severity == "caution"
    assert "60 positions of bead b2 (10 %) are those of 100 rows before" in said.message
    assert "line 302" in said.message
    assert "1 of 3 beads" in said.message
    lost = np.isnan(recording.positions_nm["b2"]).all(axis=1)
    assert np.flatnonzero(lost).tolist() == [*range(300, 350), *range(400, 410)]
    assert not np.isnan(recording.positions_nm["b1"]).any()


def test_a_camera_that_stalls_is_told(tmp_path):
    positions = motion(900)
    for xyz in positions.values():
        xyz[500:504] = xyz[499]
    (said,) = [n for n in read(tmp_path, positions).notices if n.code == "repeated_rows"]
    assert said.severity == "info"
    assert "the row before" in said.message


def test_coarse_positions_come_back_by_chance_and_are_not_told(tmp_path):
    random = np.random.default_rng(3)
    positions = {bead: 5.0 * random.integers(1, 3, size=(900, 3)) for bead in ("b1", "ref1")}
    assert "repeated_rows" not in codes(read(tmp_path, positions))


def test_positions_in_steps_coarser_than_the_motion_are_told(tmp_path):
    positions = motion(900, beads=("b1", "b2", "ref1"))
    change = np.std(np.diff(positions["b1"][:, 0]))
    for share, told in ((0.2, False), (2.0, True)):
        step = round(share * change, 1)
        coarse = {bead: xyz.copy() for bead, xyz in positions.items()}
        coarse["b1"][:, :2] = step * np.round(coarse["b1"][:, :2] / step)
        coarse["b1"][300] = coarse["b1"][299]  # a copy of a frame is no coarse step
        said = [n for n in read(tmp_path, coarse).notices if n.code == "coarse_positions"]
        assert [n.bead for n in said] == ["b1"] * told
        if told:
            assert said[0].message.startswith(
                f"x and y of bead b1 are stored in steps of {step:.2g}"
            )


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "µs"), (1e9, "ns")])
def test_stamps_that_are_not_in_seconds_are_named(tmp_path, factor, unit):
    time = [repr(factor * i / RATE) for i in range(400)]
    with pytest.raises(
        RecordingError, match=rf"time_s seems not to be in s but in {unit}"
    ) as caught:
        read(tmp_path, motion(400), time=time)
    assert "unknown" not in str(caught.value)
    with pytest.raises(RecordingError, match=r"too few: time_s .*ms or µs") as caught:
        read(tmp_path, motion(400), setup_of(rate="unknown"), time=time)


def test_a_rate_of_no_camera_is_refused_where_it_is_taken_from_the_stamps(tmp_path):
    time = [repr(1e-6 * i / RATE) for i in range(400)]
    with pytest.raises(RecordingError, match=r"1e\+08 frames per second, which are too many"):
        read(tmp_path, motion(400), setup_of(rate="unknown"), time=time)
    with pytest.raises(RecordingError, match=r"\(1e\+06 times that\)"):
        read(tmp_path, motion(400), time=time)
    assert read(tmp_path, motion(400), setup_of(rate="unknown")).setup.camera.frame_rate_hz.known


def test_a_canonical_file_with_coarse_stamps_is_told_what_it_can_do(tmp_path):
    time = [f"{i // 2 / RATE:.4f}" for i in range(400)]
    with pytest.raises(RecordingError, match="occurs twice") as caught:
        read(tmp_path, motion(400), time=time)
    assert "a column frame" in caught.value.mend
    assert "rounded = true" not in caught.value.mend
    lines = canonical_lines(motion(400), time=[str(i // 2) for i in range(400)])
    lines[0] = lines[0].replace("time_s", "frame")
    with pytest.raises(RecordingError, match="occurs twice") as caught:
        load(write(tmp_path / "f.csv", lines), setup_of())
    assert "a column time_s" in caught.value.mend
    lines = canonical_lines(motion(400), time=[str(i) for i in range(400)])
    lines[0] = lines[0].replace("time_s", "frame")
    assert len(load(write(tmp_path / "f.csv", lines), setup_of()).time_s) == 400


def test_frame_numbers_beside_stamps_that_are_missing_are_told(tmp_path):
    time = [f"{i},{i / RATE:.4f}" for i in range(400)]
    time[50] = "50,"
    lines = canonical_lines(motion(400), time=time)
    lines[0] = f"frame,{lines[0]}"
    recording = load(write(tmp_path / "f.csv", lines), setup_of())
    (said,) = [n for n in recording.notices if n.code == "stamps_not_used"]
    assert (said.severity, "1 of 400" in said.message) == ("caution", True)
    np.testing.assert_allclose(recording.time_s, np.arange(400) / RATE)


def test_magnets_without_any_position_and_a_single_row_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="magnets have no position in any row"):
        read(tmp_path, motion(400), magnet=[""] * 400)
    with pytest.raises(RecordingError, match="has one row"):
        read(tmp_path, motion(1))


def test_a_plateau_that_is_lost_with_its_magnet_position_is_told(tmp_path):
    magnet = [2.0] * 150 + [""] * 250
    recording = read(tmp_path, motion(400), magnet=magnet)
    assert [(p.start, p.stop) for p in recording.plateaus] == [(0, 150)]
    (said,) = [n for n in recording.notices if n.code == "magnet_missing"]
    assert said.severity == "caution"
    assert "250 of 400 frames (2.5 s)" in said.message
    positions = motion(400)
    for xyz in positions.values():  # frames in which nothing was seen are no loss
        xyz[150:] = np.nan
    assert "magnet_missing" not in codes(read(tmp_path, positions, magnet=magnet))


@pytest.mark.parametrize("name", ["Magnet_mm", "magnet_um", "magnet", "mag_mm", "temperature_K"])
def test_a_misspelt_magnet_column_is_named(tmp_path, name):
    lines = canonical_lines(motion(400), magnet=[2.0] * 400)
    lines[0] = lines[0].replace("magnet_mm", name)
    recording = load(write(tmp_path / "r.csv", lines), setup_of())
    said = [n for n in recording.notices if n.code == "magnet_not_used"]
    if name == "temperature_K":
        assert not said
    else:
        assert (said[0].severity, name in said[0].message) == ("caution", True)
        assert "magnet_mm, in mm" in said[0].message


def test_heights_in_micrometres_are_remarked_on(tmp_path):
    positions = motion(400, beads=("b1", "b2", "ref1"))
    for bead in ("b1", "b2"):
        positions[bead][:, 2] /= 1000
    recording = read(tmp_path, positions)
    (said,) = [n for n in recording.notices if n.code == "unit"]
    assert (said.severity, said.bead, said.axis) == ("caution", None, "z")
    assert "height of b1, b2 changes by no more than" in said.message
