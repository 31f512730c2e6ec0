"""Tracking files of MagScope: any order of batches, ragged frames, and what is refused."""

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mtpipe
from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.magscope import in_order, spread
from tests.ingest_recordings import (
    RATE,
    START_NS,
    N,
    codes,
    height,
    magscope_batches,
    magscope_positions,
    preset,
    sentences,
    survives_a_round_trip,
    table,
    write,
    write_magscope,
)

MAGSCOPE = {"preset": "magscope-hdf5"}


@pytest.mark.parametrize("names", [("_ns", "_nm"), ("", "")])
def test_magscope_hdf5(tmp_path, names):
    positions = magscope_positions()
    positions[3][11] = np.nan
    batches = magscope_batches(positions)
    path = tmp_path / "Tracking Data 20261121.h5"
    write_magscope(path, [batches[k] for k in (1, 0, 2, 5, 4, 3, 6, 7)], names=names)
    recording = mtpipe.load(tmp_path, preset(MAGSCOPE))
    kept = np.setdiff1d(np.arange(N), np.arange(250, 260))
    assert recording.frame.tolist() == kept.tolist()
    np.testing.assert_allclose(recording.time_s, kept / RATE, atol=1e-9)
    np.testing.assert_array_equal(recording.positions_nm["b3"], positions[3][kept])
    late = kept >= 100
    np.testing.assert_array_equal(recording.positions_nm["b7"][late], positions[7][kept][late])
    assert np.isnan(recording.positions_nm["b7"][~late]).all()
    assert "1700000000.123456789 s after 1970" in sentences(recording)
    assert {"no_magnet", "camera_gaps", "lost_frames"} <= codes(recording)
    survives_a_round_trip(recording)


def test_magscope_files_of_one_recording_follow_in_time(tmp_path):
    positions = magscope_positions()
    batches = magscope_batches(positions)
    write_magscope(tmp_path / "Tracking Data 2.h5", batches[:4])
    write_magscope(tmp_path / "Tracking Data 1.h5", batches[4:])
    together = mtpipe.load(tmp_path, preset(MAGSCOPE))
    (tmp_path / "one").mkdir()
    path = write_magscope(tmp_path / "one" / "Tracking Data.h5", batches)
    alone = mtpipe.load(path, preset({**MAGSCOPE, "beads": {"name": "bead{n}"}}))
    np.testing.assert_array_equal(together.time_s, alone.time_s)
    for bead in (3, 7):
        np.testing.assert_array_equal(
            together.positions_nm[f"b{bead}"], alone.positions_nm[f"bead{bead}"]
        )


def test_files_of_two_recordings_are_not_joined(tmp_path):
    batches = magscope_batches(magscope_positions())
    for number in (1, 2):
        path = write_magscope(tmp_path / f"Tracking Data {number}.h5", batches[4 * number - 4 :])
        with h5py.File(path, "a") as file:
            file["tracking"].attrs["recording_id"] = np.uint64(number)
    with pytest.raises(RecordingError, match=r"belongs to another recording than Tracking Data 1"):
        mtpipe.load(tmp_path, preset(MAGSCOPE))


def test_a_magnet_log_beside_a_magscope_file(tmp_path):
    clock = START_NS * 1e-9 + np.arange(0, 4.2, 0.05)
    write(tmp_path / "zaber.log", table([clock, height(clock - START_NS * 1e-9)], "\t"))
    path = write_magscope(tmp_path / "t.h5", magscope_batches(magscope_positions()))
    log = {"file": "zaber.log", "header": False, "time_column": 1, "column": 2,
           "clock_offset_s": -START_NS * 1e-9}  # fmt: skip
    recording = mtpipe.load(path, preset({**MAGSCOPE, "magnet": log}, tolerance_mm=1e-5))
    known = np.isfinite(recording.magnet_mm)
    np.testing.assert_allclose(
        recording.magnet_mm[known], height(recording.time_s[known]), atol=1e-5
    )


@settings(max_examples=40)
@given(order=st.permutations(range(8)))
def test_any_order_of_batches_is_the_same_recording(tmp_path_factory, order):
    folder = tmp_path_factory.mktemp("magscope")
    batches = magscope_batches(magscope_positions())
    straight = write_magscope(folder / "a.h5", batches)
    mixed = write_magscope(folder / "b.h5", [batches[k] for k in order])
    first, second = (mtpipe.load(p, preset(MAGSCOPE)) for p in (straight, mixed))
    np.testing.assert_array_equal(first.time_s, second.time_s)
    np.testing.assert_array_equal(first.frame, second.frame)
    for bead, xyz in first.positions_nm.items():
        np.testing.assert_array_equal(xyz, second.positions_nm[bead])


@given(st.lists(st.integers(0, 9), min_size=1, max_size=40))
def test_runs_of_batches_cover_every_frame_once_and_in_order(sequence):
    frames = [f for start, stop in in_order(np.array(sequence)) for f in range(start, stop)]
    assert sorted(frames) == list(range(len(sequence)))
    assert [(sequence[f], f) for f in frames] == sorted((s, f) for f, s in enumerate(sequence))


def test_a_bead_twice_in_a_frame_is_refused():
    offsets, ids = np.array([4, 6, 8]), np.array([3, 7, 7, 7])
    with pytest.raises(ValueError, match="bead 7 is there twice"):
        spread(offsets, ids, np.zeros((4, 3)), (3, 7))


def without(name):
    def change(group):
        del group[name]

    return change


def replaced(name, change):
    def apply(group):
        values = change(group[name][:])
        del group[name]
        group[name] = values

    return apply


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda g: g.attrs.update(schema_version=2), "schema_version 2, only 1 is known"),
        (lambda g: g.attrs.pop("schema_version"), "schema_version None"),
        (without("frame_offsets"), "no dataset /tracking/frame_offsets"),
        (without("bead_ids"), "no dataset /tracking/bead_ids"),
        (without("positions_nm"), "no dataset /tracking/positions_nm"),
        (without("frame_timestamps_ns"), "no dataset /tracking/frame_timestamps_ns"),
        (without("frame_batch_sequence"), "no dataset /tracking/frame_batch_sequence"),
        (replaced("frame_offsets", lambda v: v[:-1]), "has 390 frame_offsets for 390 frames"),
        (replaced("frame_offsets", lambda v: v[::-1]), "do not increase from 0"),
        (replaced("frame_offsets", lambda v: np.minimum(v, 600)), "end at 600, but 680 records"),
        (replaced("frame_batch_sequence", lambda v: v[:9]), "for 9 frames of 390"),
        (replaced("positions_nm", lambda v: v[:, :2]), r"positions of shape \(680, 2\)"),
        (replaced("bead_ids", lambda v: v * 0), "bead 0 is there twice"),
    ],
)
def test_faults_of_magscope_files(tmp_path, change, what):
    path = write_magscope(tmp_path / "t.h5", magscope_batches(magscope_positions()))
    with h5py.File(path, "a") as file:
        change(file["tracking"])
    with pytest.raises(RecordingError, match=what):
        mtpipe.load(path, preset(MAGSCOPE))


def test_another_hdf5_file_and_text_are_no_magscope_files(tmp_path):
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["timestamp"] = [0.0, 1.0]
    with pytest.raises(RecordingError, match="no group /tracking"):
        mtpipe.load(path, preset(MAGSCOPE))
    with pytest.raises(RecordingError, match="cannot be read as hdf5"):
        mtpipe.load(write(path, ["1 2"]), preset(MAGSCOPE))
