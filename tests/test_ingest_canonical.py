"""Canonical recordings: what is written is read, and what is wrong is told with its place."""

import contextlib
import gzip
import hashlib
import warnings

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mtpipe.ground.errors import MtpipeError, RecordingError, SetupError
from mtpipe.ingest import load
from mtpipe.recording.recording import Recording
from tests.ingest_recordings import RATE, canonical_lines, codes, motion, setup_of, write

QUICK = settings(max_examples=25, suppress_health_check=list(HealthCheck))


@QUICK
@given(
    change=arrays(
        np.float64,
        (150, 6),
        elements=st.one_of(st.just(np.nan), st.floats(-2000, 2000, allow_subnormal=False)),
        fill=st.just(0.0),
    ),
    kind=st.sampled_from(["csv", "csv.gz", "parquet"]),
)
def test_what_is_written_is_read(tmp_path, change, kind):
    positions = motion(150)
    for k, xyz in enumerate(positions.values()):
        xyz += change[:, 3 * k : 3 * k + 3]
    path = tmp_path / f"recording.{kind}"
    lines = ["# made up", "#", *canonical_lines(positions, magnet=[2.5] * 150)]
    if kind == "parquet":
        columns = {
            f"{b}_{a}_nm": p[:, k] for b, p in positions.items() for k, a in enumerate("xyz")
        }
        time = np.arange(150) / RATE
        pq.write_table(pa.table({"time_s": time, "magnet_mm": np.full(150, 2.5), **columns}), path)
    elif kind == "csv":
        write(path, lines)
    else:
        path.write_bytes(gzip.compress("\n".join(lines).encode()))
    recording = load(path, setup_of())
    for bead, xyz in positions.items():
        np.testing.assert_array_equal(recording.positions_nm[bead], xyz)
    np.testing.assert_array_equal(recording.magnet_mm, 2.5)
    np.testing.assert_array_equal(recording.frame, np.arange(150))
    assert [(p.start, p.stop, p.magnet_mm) for p in recording.plateaus] == [(0, 150, 2.5)]


@pytest.mark.slow
@settings(max_examples=150, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_corruption_gives_a_recording_or_a_sentence(tmp_path, data):
    lines = canonical_lines(motion(120), magnet=[2.5] * 120)
    kind = data.draw(st.sampled_from(["csv", "csv.gz", "parquet"]))
    if kind == "parquet":
        table = {name: [1.0 * i for i in range(120)] for name in lines[0].split(",")}
        pq.write_table(pa.table(table), tmp_path / "r")
        content = bytearray((tmp_path / "r").read_bytes())
    else:
        content = bytearray("\n".join(lines).encode())
        if kind == "csv.gz":
            content = bytearray(gzip.compress(bytes(content), mtime=0))
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        piece = data.draw(
            st.one_of(
                st.binary(max_size=6),
                st.sampled_from([b"nan", b"1e300", b"-inf", b",,", b"\n\n", b'"', b"\r", b"9999"]),
            )
        )
        content[place : place + data.draw(st.sampled_from([0, 1, len(piece), 400]))] = piece
        if not content:
            break
    path = tmp_path / f"recording.{kind}"
    path.write_bytes(bytes(content))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with contextlib.suppress(MtpipeError):
            assert isinstance(load(path, setup_of()), Recording)


def faulty(change):
    lines = canonical_lines(motion(200), magnet=[2.5] * 200)
    change(lines)
    return lines


def set_cell(line, column, text):
    def change(lines):
        cells = lines[line].split(",")
        cells[column] = text
        lines[line] = ",".join(cells)

    return change


@pytest.mark.parametrize(
    ("change", "where", "what"),
    [
        (set_cell(41, 3, "abc"), "line 42, column b1_y_nm", "'abc' is no number"),
        (set_cell(41, 0, "0.39"), "line 42", "occurs twice"),
        (set_cell(41, 0, "0.2"), "line 42", "goes backward"),
        (set_cell(41, 0, ""), "line 42", "missing"),
        (set_cell(200, 0, "1e9"), "line 201", "frames are missing before it"),
        (set_cell(0, 3, "b1_x_nm"), "recording.csv", "two columns named 'b1_x_nm'"),
        (set_cell(0, 0, "t"), "recording.csv", "no column time_s or frame"),
        (lambda lines: lines.__setitem__(7, lines[7] + ",1"), "line 8", "has 9 columns where 8"),
        (lambda lines: lines.__delitem__(slice(1, None)), "recording.csv", "no rows"),
        (lambda lines: lines.__setitem__(slice(None), ["a,b", "1,2"]), "csv", "no column time_s"),
    ],
)
def test_an_error_names_its_place(tmp_path, change, where, what):
    path = write(tmp_path / "recording.csv", faulty(change))
    with pytest.raises(RecordingError) as caught:
        load(path, setup_of())
    assert what in caught.value.message
    assert where in str(caught.value.where)


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "is empty"),
        (b"\x00\x01\x02\x03junk", "binary file"),
        (gzip.compress(b"time_s,b1_x_nm\n" + b"0,1\n" * 9000, mtime=0)[:60], "cut off"),
        (b"\x1f\x8bjunk that is no gzip", "damaged"),
        (b"PAR1 no parquet", "damaged"),
        (b"\xd0\xcf\x11\xe0 a workbook", "Excel"),
        (b"\x89HDF\r\n\x1a\n", "an HDF5 file"),
    ],
)
def test_a_file_that_is_no_table_says_so(tmp_path, content, what):
    (tmp_path / "recording.csv").write_bytes(content)
    with pytest.raises(RecordingError, match=what):
        load(tmp_path / "recording.csv", setup_of())


def test_a_fault_far_down_is_found_beyond_the_first_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr("mtpipe.ingest.lines.BLOCK_BYTES", 4096)
    lines = faulty(set_cell(180, 4, "1.2.3"))
    path = write(tmp_path / "recording.csv", lines)
    with pytest.raises(RecordingError, match=r"'1\.2\.3' is no number") as caught:
        load(path, setup_of())
    assert "line 181, column b1_z_nm" in str(caught.value.where)


def test_arrays_that_grow_keep_every_number(tmp_path, monkeypatch):
    monkeypatch.setattr("mtpipe.ingest.collect.FIRST_ROWS", 16)
    monkeypatch.setattr("mtpipe.ingest.lines.BLOCK_BYTES", 2048)
    positions = motion(500)
    recording = load(write(tmp_path / "r.csv", canonical_lines(positions)), setup_of())
    np.testing.assert_array_equal(recording.positions_nm["b1"], positions["b1"])
    np.testing.assert_allclose(recording.time_s, np.arange(500) / RATE)


def test_a_camera_gap_stays_a_gap(tmp_path):
    positions = motion(300)
    lines = canonical_lines(positions)
    del lines[101:151]
    recording = load(write(tmp_path / "r.csv", lines), setup_of())
    assert recording.frame[99:102].tolist() == [99, 150, 151]
    trace = recording.trace_nm("b1", recording.plateaus[0])
    assert np.isnan(trace[100:150]).all()
    np.testing.assert_array_equal(trace[150:], positions["b1"][150:])
    assert "camera_gaps" in codes(recording)


def test_frame_numbers_serve_as_time(tmp_path):
    lines = canonical_lines(motion(300), time=[str(i + (i >= 100) * 7) for i in range(300)])
    lines[0] = lines[0].replace("time_s", "frame")
    recording = load(write(tmp_path / "r.csv", lines), setup_of())
    assert recording.frame[99:101].tolist() == [99, 107]
    assert recording.time_s[100] == pytest.approx(107 / RATE)


def test_a_missing_axis_is_nan_and_told(tmp_path):
    positions = motion(200, beads=("b1",))
    lines = [line.rsplit(",", 1)[0] for line in canonical_lines(positions)]
    recording = load(write(tmp_path / "r.csv", lines), setup_of(reference=()))
    assert np.isnan(recording.positions_nm["b1"][:, 2]).all()
    assert "no_axis" in codes(recording)


def test_a_folder_is_a_series_in_order_of_its_numbers(tmp_path):
    positions = motion(300)
    lines = canonical_lines(positions)
    for name, rows in (("2.csv", slice(1, 101)), ("10.csv", slice(101, 301))):
        write(tmp_path / name, [lines[0], *lines[rows]])
    (tmp_path / "README.md").write_text("about it")
    recording = load(tmp_path, setup_of())
    np.testing.assert_array_equal(recording.positions_nm["b1"], positions["b1"])
    assert [f.name for f in recording.files] == ["2.csv", "10.csv"]
    digest = hashlib.sha256((tmp_path / "2.csv").read_bytes()).hexdigest()
    assert recording.files[0].sha256 == digest
    assert recording.files[0].bytes == (tmp_path / "2.csv").stat().st_size


def test_setup_is_the_one_beside_the_recording(tmp_path):
    path = write(tmp_path / "r.csv", canonical_lines(motion(200)))
    with pytest.raises(SetupError, match="no such setup file"):
        load(path)
    with pytest.raises(RecordingError, match="no such file"):
        load(tmp_path / "absent.csv", setup_of())


@pytest.mark.parametrize(
    ("source", "mark", "decimal", "encoding", "before"),
    [
        ({"delimiter": "semicolon", "decimal": ","}, ";", ",", "utf-8", []),
        ({"decimal": ","}, ";", ",", "utf-8", []),
        ({"delimiter": "tab"}, "\t", ".", "utf-8", []),
        ({"encoding": "utf-16"}, ",", ".", "utf-16", []),
        ({"skip_lines": 1, "comment": "%"}, ",", ".", "utf-8", ["about it", "% more"]),
        ({"leave_out": ["ref1"]}, ",", ".", "utf-8", []),
    ],
)
def test_canonical_columns_may_be_written_otherwise(
    tmp_path, source, mark, decimal, encoding, before
):
    positions = motion(200)
    table = str.maketrans({",": mark, ".": decimal})
    lines = [line.translate(table) for line in canonical_lines(positions)]
    path = write(tmp_path / "r.csv", [*before, *lines], encoding)
    if mark != ",":
        stated = {";": "semicolon", "\t": "tab"}[mark]
        with pytest.raises(RecordingError, match=f'write delimiter = "{stated}" in'):
            load(path, setup_of())
    recording = load(path, setup_of(source, reference=()))
    np.testing.assert_array_equal(recording.positions_nm["b1"], positions["b1"])


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ({"header": False}, "header: a canonical file has a line of column names"),
        ({"rotation": {"column": 1, "unit": "turn"}}, "beads is missing"),
        ({"z_zero": {"value_nm": 100.0}}, "z_zero: in a canonical recording z is the height"),
        ({"z_zero_of": {"b1": {"unknown": True}}}, "z_zero: in a canonical recording"),
    ],
)
def test_what_a_canonical_recording_cannot_follow_is_refused(tmp_path, source, words):
    path = write(tmp_path / "r.csv", canonical_lines(motion(200)))
    with pytest.raises(SetupError, match=words):
        load(path, setup_of(source))
