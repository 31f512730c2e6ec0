"""The cases of ../shared/cases/files: each read with the right numbers, or refused in words."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest import load
from mtpipe.setup.setup import read_setup
from mtpipe.tracking.stack import open_stack
from mtpipe.tracking.stack_times import frame_times

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases"
FILES = CASES / "files"
# The plain text of the same numbers, by frame rate.
PLAIN = {120.0: "comment_between_rows", 60.0: "units_row_under_header"}
SLACK_NM = 0.26  # integers of half a nanometre (scale_attribute); text is rounded to 0.001 nm
READ = [
    "comment_between_rows", "excel_sep_line", "file_name_latin1", "folder [A1] brackets",
    "hdf_array_of_three_axes", "header_cp1252", "header_mu_or_micro", "header_with_quoted_mark",
    "lines_before_header", "lost_word_msvc_short", "lost_word_padded", "matlab_struct",
    "numpy_npy", "pandas_hdf_table", "parquet_clock_time", "row_ends_with_delimiter",
    "scale_attribute", "tdms_clock_time_channel", "tdms_rate_unknown",
    "unit_attribute_contradicts", "units_row_under_header", "utf16_with_mark",
]  # fmt: skip
REFUSED = {
    "mixed_decimal_marks": r"'4\.1583' is no number",
    "tdms_cut_contiguous": "is cut off in its last segment: 2500 rows are whole",
    "tdms_cut_interleaved": "is cut off in its last segment: 2000 rows are whole",
    "tdms_rate_contradicts": "setup says 120 frames per second, the file says 60",
}
TAKEN = {"tdms_cut_contiguous": 2500, "tdms_cut_interleaved": 2000}

pytestmark = pytest.mark.skipif(not FILES.exists(), reason="../shared/cases/files is not there")


def target_of(case):
    folder = FILES / case
    files = [f for f in folder.iterdir() if f.name not in ("expected.md", "setup.toml")]
    return files[0] if len(files) == 1 else folder


def plain_positions(rate):
    return load(target_of(PLAIN[rate])).positions_nm["b1"]


@pytest.mark.parametrize("case", READ)
def test_positions_are_those_of_the_plain_text(case):
    recording = load(target_of(case))
    rate = recording.setup.camera.frame_rate_hz.value
    expected = plain_positions(rate)
    found = recording.positions_nm["b1"]
    lost = np.isnan(found).any(axis=1)
    assert np.count_nonzero(lost) == (10 if "lost" in case or case == "scale_attribute" else 0)
    np.testing.assert_allclose(found[~lost], expected[~lost], atol=SLACK_NM, rtol=0)
    np.testing.assert_allclose(recording.time_s, np.arange(len(found)) / rate, atol=1e-4)


@pytest.mark.parametrize("case", REFUSED)
def test_what_would_give_a_wrong_force_is_refused(case):
    with pytest.raises(RecordingError, match=REFUSED[case]):
        load(target_of(case))


@pytest.mark.parametrize("case", TAKEN)
def test_what_is_whole_can_be_taken(case, tmp_path):
    shutil.copytree(FILES / case, tmp_path / "case")
    setup = tmp_path / "case" / "setup.toml"
    setup.write_text(setup.read_text().replace("[source]\n", '[source]\nincomplete = "take"\n'))
    recording = load(tmp_path / "case" / "rec.tdms", read_setup(setup))
    found = recording.positions_nm["b1"]
    assert len(found) == TAKEN[case]
    expected = plain_positions(120.0)[: len(found)]
    np.testing.assert_allclose(found, expected, atol=SLACK_NM, rtol=0)


def film(case):
    """A film, its frames, and the frame rate of its setup."""
    folder = FILES / case
    films = sorted(folder.glob("film*.tif"))
    stack = open_stack(films[0] if len(films) == 1 else folder)
    rate = read_setup(folder / "setup.toml").camera.frame_rate_hz.value
    return stack, np.concatenate(list(stack.chunks())), rate


@pytest.mark.parametrize(
    ("case", "cautions"),
    [
        ("film_last_axis_of_one", 0), ("film_split_header_of_whole", 0),
        ("film_stopped_early", 1), ("film_white_is_zero", 0),
    ],
)  # fmt: skip
def test_a_film_has_the_frames_of_the_plain_one(case, cautions):
    _, expected, _ = film("film_plain")
    stack, frames, _ = film(case)
    np.testing.assert_array_equal(frames, expected)
    assert sum(notice.severity == "caution" for notice in stack.notices) == cautions


def test_intervals_of_films_that_are_wrong():
    stack, _, rate = film("film_interval_rounded")
    with pytest.raises(RecordingError, match=r'\[tracking\] times = "setup"'):
        frame_times(stack.stamps, stack.frames, rate)
    time_s, _ = frame_times(stack.stamps, stack.frames, rate, put_aside=True)
    np.testing.assert_allclose(time_s, np.arange(stack.frames) / rate)
    stack, _, rate = film("film_interval_of_one_second")
    time_s, _ = frame_times(stack.stamps, stack.frames, rate)
    np.testing.assert_allclose(time_s, np.arange(stack.frames) / rate)


def test_rows_in_chunks_of_their_own_are_read_together():
    recording = load(target_of("slow_hdf5_row_chunks"))
    assert len(recording.time_s) == 8000


def test_a_folder_with_brackets_in_its_name():
    recording = load(CASES / "faults" / "glob_folder" / "exp[2026]")
    assert len(recording.time_s) == 300
