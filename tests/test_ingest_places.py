"""Files wherever they lie and whatever they are called, and clocks that count from far away."""

import os
import sys

import numpy as np
import pytest

from mtpipe.ground.errors import MtpipeError, RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ingest import load
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.setup.tables import Plateaus
from tests.ingest_recordings import RATE, N, canonical_lines, motion, setup_of, write


@pytest.mark.parametrize("folder", ["exp[2026]", "[A1]", "a [b] c", "what?", "st*r", "x]["])
@pytest.mark.parametrize("pattern", ["*.csv", "part_?.csv", "part_[12].csv", "inner/../*.csv"])
def test_patterns_hold_for_files_and_not_for_the_folders_they_are_in(tmp_path, folder, pattern):
    place = tmp_path / folder
    (place / "inner").mkdir(parents=True)
    # a folder that the name would match, were it a pattern
    (tmp_path / "exp2").mkdir()
    (tmp_path / "A").mkdir()
    positions = motion()
    lines = canonical_lines(positions)
    write(place / "part_1.csv", lines[:150])
    write(place / "part_2.csv", [lines[0], *lines[150:]])
    recording = load(place, setup_of({"files": [pattern]}))
    np.testing.assert_array_equal(recording.positions_nm["b1"], positions["b1"])
    again = load(place, setup_of({"files": [str(place / pattern)]}))
    assert len(again.time_s) == N


def test_a_file_with_brackets_in_its_name_is_named_as_it_is(tmp_path):
    positions = motion()
    write(tmp_path / "bead[1].csv", canonical_lines(positions))
    write(tmp_path / "bead1.csv", canonical_lines(motion(seed=1)))
    recording = load(tmp_path, setup_of({"files": ["bead[1].csv"]}))
    np.testing.assert_array_equal(recording.positions_nm["b1"], positions["b1"])
    with pytest.raises(RecordingError, match=r"no file 'cell\[1\]\.csv'"):
        load(tmp_path, setup_of({"files": ["cell[1].csv"]}))


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text elsewhere")
def test_names_that_are_no_utf_8_become_text_that_can_be_written(tmp_path):
    folder = tmp_path / os.fsdecode(b"f\xe4lle")
    folder.mkdir()
    path = write(folder / os.fsdecode(b"rec_\xfc.csv"), canonical_lines(motion()))
    recording = load(path, setup_of())
    assert recording.name == "rec_\\xfc.csv"
    assert recording.files[0].name == "rec_\\xfc.csv"
    write(path, [*canonical_lines(motion())[:200], "1,2"])
    with pytest.raises(RecordingError) as caught:
        load(path, setup_of())
    assert "f\\xe4lle/rec_\\xfc.csv, line 201" in str(caught.value)
    for text in (str(caught.value), Notice("code", "info", str(path)).message,
                 str(MtpipeError(str(path), where=str(path), mend=str(path)))):  # fmt: skip
        text.encode("utf-8")


@pytest.mark.parametrize("rate", [RATE, "unknown"])
@pytest.mark.parametrize("digits", [4, 6, 12])
def test_a_clock_that_counts_from_far_away_changes_no_frame_and_no_rate(tmp_path, rate, digits):
    """Seconds since 1970 keep 0.1 µs: frames, plateaus and the rate stay where they were."""
    n = 3000
    magnet = np.repeat([3.0, 2.0, 1.0], n // 3)
    stamps = np.array([float(f"{i / RATE * 1.2345:.{digits}f}") for i in range(n)])
    true = RATE / 1.2345
    setup = setup_of(rate=true if rate != "unknown" else rate, minimum_s=5.0, settle_s=0.3 * 1.2345)
    found = []
    for start in (0.0, 1e9):
        time = [repr(float(t)) for t in stamps + start]
        path = write(tmp_path / "r.csv", canonical_lines(motion(n), time, magnet))
        found.append(load(path, setup))
    near, far = found
    np.testing.assert_array_equal(near.frame, far.frame)
    assert near.plateaus == far.plateaus
    rates = [one.setup.camera.frame_rate_hz.value for one in found]
    assert rates[1] == pytest.approx(rates[0], rel=1e-9)


def test_a_plateau_of_exactly_the_shortest_time_is_one():
    for start in (0.0, 1e9, 1.7e9 + 1 / 3):
        time = start + np.arange(101) / 100
        magnet = np.repeat([1.0, 2.0], [50, 51])
        found = find_plateaus(time, magnet, Plateaus(minimum_s=0.5, settle_s=0.01))
        assert [(p.start, p.stop) for p in found] == [(0, 50), (51, 101)]
