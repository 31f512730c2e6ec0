"""A file that is cut off is said to be; `incomplete = "take"` takes exactly what is whole."""

import gzip

import h5py
import nptdms
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from mtpipe.ground.errors import MtpipeError, RecordingError
from mtpipe.ingest import load
from mtpipe.ingest.last_row import last_row_fault
from tests.ingest_recordings import FIVE, N, assert_plain, codes, five_columns, five_setup, write


def cut(path, at):
    content = path.read_bytes()
    path.write_bytes(content[: round(at * len(content)) if at < 1 else at])
    return path


def refused_and_taken(path, columns, *, least, most, names=FIVE):
    """Refused in words; taken by choice, `least` to `most` rows, all of them right."""
    with pytest.raises(RecordingError, match="cut off") as caught:
        load(path, five_setup(names))
    assert 'incomplete = "take"' in caught.value.mend
    recording = load(path, five_setup(names, incomplete="take", minimum_s=0.1))
    rows = len(recording.time_s)
    assert least <= rows <= most
    assert_plain(recording, columns, rows=rows)
    said = [n for n in recording.notices if n.code == "file_incomplete"]
    assert said
    assert {n.severity for n in said} == {"caution"}


def write_tdms(path, columns, segments, layout):
    with nptdms.TdmsWriter(path) as writer:
        for rows in np.array_split(np.arange(N), segments):
            writer.write_segment(
                [nptdms.ChannelObject("g", k, v[rows]) for k, v in columns.items()]
            )
    if layout == "interleaved":
        path.write_bytes(interleaved(path.read_bytes(), columns, segments))
    return path


def interleaved(content, columns, segments):
    """The same segments with values row by row, as NI's file format has them (TOC bit 5)."""
    out, at = b"", 0
    for rows in np.array_split(np.arange(N), segments):
        next_segment = int.from_bytes(content[at + 12 : at + 20], "little")
        raw = int.from_bytes(content[at + 20 : at + 28], "little")
        toc = int.from_bytes(content[at + 4 : at + 8], "little") | 1 << 5
        head = content[at : at + 4] + toc.to_bytes(4, "little") + content[at + 8 : at + 28 + raw]
        out += head + np.column_stack([v[rows] for v in columns.values()]).tobytes()
        at += 28 + next_segment
    return out


@pytest.mark.parametrize("layout", ["contiguous", "interleaved"])
@pytest.mark.parametrize("segments", [1, 4])
@pytest.mark.parametrize("at", [0.4, 0.83, 0.999])
def test_tdms(tmp_path, layout, segments, at, capfd):
    columns = five_columns()
    path = write_tdms(tmp_path / "r.tdms", columns, segments, layout)
    assert_plain(load(path, five_setup()), columns)
    cut(path, at)
    if layout == "contiguous" and segments == 1 and at < 0.81:
        with pytest.raises(MtpipeError, match="cut off"):  # of Z, which is last, nothing is there
            load(path, five_setup())
        return
    whole = N * (int(at * segments) / segments)
    least = int(whole) if layout == "contiguous" else int(0.9 * at * N)
    refused_and_taken(path, columns, least=least, most=int(at * N) + 1)
    assert capfd.readouterr().err == ""  # npTDMS's own warnings


def test_tdms_of_a_program_that_crashed(tmp_path):
    """LabVIEW leaves the length of the segment it writes at its largest value."""
    columns = five_columns()
    path = write_tdms(tmp_path / "r.tdms", columns, 1, "interleaved")
    content = bytearray(path.read_bytes()[:-400])
    content[12:20] = b"\xff" * 8
    path.write_bytes(content)
    refused_and_taken(path, columns, least=N - 11, most=N - 10)


def test_tdms_cut_within_the_head_of_a_segment(tmp_path):
    columns = five_columns()
    path = write_tdms(tmp_path / "r.tdms", columns, 2, "contiguous")
    second = path.read_bytes().rindex(b"TDSm")
    cut(path, second + 20)
    refused_and_taken(path, columns, least=N // 2, most=N // 2)


@pytest.mark.parametrize("version", ["4", "5"])
@pytest.mark.parametrize("packed", [False, True])
def test_matlab_loses_the_variable_that_is_cut(tmp_path, version, packed):
    columns = five_columns()
    variables = {k: v[:, None] for k, v in columns.items()} | {"more": np.zeros(50)}
    packing = {"do_compression": packed} if version == "5" else {}
    scipy.io.savemat(tmp_path / "r.mat", variables, format=version, **packing)
    assert_plain(load(tmp_path / "r.mat", five_setup()), columns)
    cut(tmp_path / "r.mat", (tmp_path / "r.mat").stat().st_size - 30)
    refused_and_taken(tmp_path / "r.mat", columns, least=N, most=N)
    cut(tmp_path / "r.mat", 0.6)
    with pytest.raises(RecordingError, match="no column 'Y'"):
        load(tmp_path / "r.mat", five_setup(incomplete="take"))


@pytest.mark.parametrize("chunks", [None, (50,), (400,)])
def test_hdf5(tmp_path, chunks):
    columns = five_columns()
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values, chunks=chunks)
    size = (tmp_path / "r.h5").stat().st_size
    last = 50 if chunks == (50,) else 400
    cut(tmp_path / "r.h5", size - 100)
    if chunks == (400,):
        with pytest.raises(RecordingError, match=f"is cut off: {size - 100} of {size} bytes"):
            load(tmp_path / "r.h5", five_setup())
        return
    refused_and_taken(tmp_path / "r.h5", columns, least=N - last - 13, most=N - 12)


def test_hdf5_one_array_appended_frame_by_frame(tmp_path):
    columns = five_columns()
    table = np.column_stack(list(columns.values()))
    with h5py.File(tmp_path / "r.h5", "w", libver="latest") as file:
        made = file.create_dataset("all", (0, 5), dtype="f8", maxshape=(None, 5), chunks=(20, 5))
        for row in range(0, N, 20):
            made.resize(row + 20, axis=0)
            made[row : row + 20] = table[row : row + 20]
    cut(tmp_path / "r.h5", 0.8)
    names = tuple(f"all[{k}]" for k in range(1, 6))
    refused_and_taken(tmp_path / "r.h5", columns, least=100, most=0.8 * N, names=names)


def test_hdf5_whose_program_was_stopped_between_two_columns(tmp_path):
    columns = five_columns()
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values in columns.items():
            file[name] = values[: N - 3 * (name in "YZ")]
    with pytest.raises(RecordingError, match="columns differ in length") as caught:
        load(tmp_path / "r.h5", five_setup())
    assert f'incomplete = "take" into [source] ({N - 3} rows of each)' in caught.value.mend
    recording = load(tmp_path / "r.h5", five_setup(incomplete="take"))
    assert_plain(recording, columns, rows=N - 3)
    assert "file_incomplete" in codes(recording)


@pytest.mark.parametrize("order", ["C", "F"])
def test_npy(tmp_path, order):
    columns = five_columns()
    table = np.asarray(np.column_stack(list(columns.values())), order=order)
    np.save(tmp_path / "r.npy", table)
    cut(tmp_path / "r.npy", 0.9)
    names = (1, 2, 3, 4, 5)
    if order == "F":  # the last column is not there at all
        with pytest.raises(RecordingError, match="is cut off"):
            load(tmp_path / "r.npy", five_setup(names))
        return
    refused_and_taken(tmp_path / "r.npy", columns, least=350, most=360, names=names)


@pytest.mark.parametrize("kind", ["npz", "parquet"])
def test_files_with_their_index_at_the_end_leave_nothing_to_take(tmp_path, kind):
    columns = five_columns()
    path = tmp_path / f"r.{kind}"
    if kind == "npz":
        np.savez(path, **columns)
    else:
        pq.write_table(pa.table(columns), path)
    for at in (0.5, 0.95, path.stat().st_size - 1):
        short = cut(tmp_path / path.name, at)
        for more in ({}, {"incomplete": "take"}):
            with pytest.raises(RecordingError, match=r"is cut off.*nothing can be taken from it"):
                load(short, five_setup(**more))


def text_of(columns, form="{:.4f}", mark=",", end="\n"):
    rows = [mark.join(form.format(v) for v in row) for row in zip(*columns.values(), strict=True)]
    return end.join([mark.join(columns), *rows]) + end


@pytest.mark.slow
@pytest.mark.parametrize("mark", [",", "\t", "   "])
@pytest.mark.parametrize("form", ["{:.4f}", "{:.7e}"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_text_in_the_middle_of_a_row_or_number(tmp_path, mark, form, encoding):
    columns = {k: np.array([float(form.format(x)) for x in v]) for k, v in five_columns().items()}
    content = text_of(columns, form, mark)
    end = content.rindex("\n", 0, -1)  # of the row before the last
    for at in range(end + 2, len(content) - 1):
        path = tmp_path / "r.txt"
        path.write_bytes(content[:at].encode(encoding))
        if content[:at].endswith(mark) and content[end:at].count(mark) == 4 and mark.strip(" "):
            left = load(path, five_setup())  # may as well be a frame in which z is lost
            assert_plain(left, columns, rows=N - 1)
            assert "file_incomplete" in codes(left)
            continue
        refused_and_taken(path, columns, least=N - 1, most=N - 1)
    path.write_bytes(content[:-1].encode(encoding))  # only the line end is missing
    assert_plain(load(path, five_setup()), columns)


def test_text_whose_numbers_have_any_length(tmp_path):
    """Numbers of any length: a last one shorter than all before it is left out and named."""
    columns = five_columns()
    rng = np.random.default_rng(1)
    columns["Z"] = rng.normal(1000, 30, N)
    content = text_of(columns, "{!r}").replace("np.float64(", "").replace(")", "")
    path = tmp_path / "r.csv"
    path.write_text(content[:-12])
    recording = load(path, five_setup())
    assert_plain(recording, columns, rows=N - 1)
    assert "file_incomplete" in codes(recording)
    path.write_text(content[:-1])
    assert_plain(load(path, five_setup()), columns)


def test_text_that_ends_in_zero_bytes(tmp_path):
    columns = five_columns()
    path = write(tmp_path / "r.csv", text_of(columns).splitlines())
    content = path.read_bytes()
    path.write_bytes(content[:-30] + b"\0" * 3000)
    with pytest.raises(RecordingError, match="ends in zero bytes") as caught:
        load(path, five_setup())
    assert 'incomplete = "take"' in caught.value.mend
    taken = load(path, five_setup(incomplete="take"))
    assert_plain(taken, columns, rows=len(taken.time_s))
    assert len(taken.time_s) == N - 1


@pytest.mark.parametrize("at", [0.3, 0.7, 0.98])
def test_gzipped_text(tmp_path, at):
    columns = five_columns(4000)
    path = tmp_path / "r.csv.gz"
    path.write_bytes(gzip.compress(text_of(columns).encode()))
    cut(path, at)
    refused_and_taken(path, columns, least=int(0.8 * at * 4000), most=4000)


def test_a_magnet_log_that_is_cut_off(tmp_path):
    columns = five_columns()
    write(tmp_path / "r.csv", text_of(columns).splitlines())
    log = "t,mm\n" + "".join(f"{t:.3f},3.0000\n" for t in np.arange(0, 5, 0.1))
    (tmp_path / "m.log").write_text(log[:-3])
    magnet = {"file": "m.log", "column": "mm", "time_column": "t", "unit": "mm"}
    with pytest.raises(RecordingError, match="cut off"):
        load(tmp_path / "r.csv", five_setup(magnet=magnet))
    taken = load(tmp_path / "r.csv", five_setup(magnet=magnet | {"incomplete": "take"}))
    assert_plain(taken, columns)
    assert "file_incomplete" in codes(taken)


def test_integers_and_lost_cells_at_the_end_are_whole():
    rows = b"1.5,7\n2.5,81\n3.5,\n4.5,123\n5.5,1\n"
    for last in (b"6.5,1", b"6.5,", b"6.5,nan", b"6.5,2"):
        assert last_row_fault(last, rows, "comma", ".", ("a", "b")) is None
