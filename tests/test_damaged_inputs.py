"""Look-up tables, HDF5 and MATLAB files that are damaged or foreign: one sentence, and no more."""

import gzip
import io
import json
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
import tifffile

import mtpipe
from mtpipe.ground.errors import MtpipeError, RecordingError
from mtpipe.ingest import announced, arrays
from mtpipe.ingest.announced import HARMLESS_BYTES, check_announced, check_fits
from mtpipe.ingest.arrays import open_arrays
from mtpipe.ingest.matlab_check import check_matlab
from mtpipe.ingest.parquet import open_parquet
from mtpipe.report import write_report
from mtpipe.tracking.lookup_table import LookUpTable
from mtpipe.tracking.stack import open_stack
from tests.ingest_recordings import (
    magscope_batches,
    magscope_positions,
    preset,
    setup_of,
    write_magscope,
)
from tests.report_folder import write_run_folder

FAULTS = Path(__file__).parents[2] / "shared" / "cases" / "faults"
ODD = (None, -1, 0, 3.5, "odd", [], [1, 2, 3], {}, True, 1e99)


def said(read):
    """What is said against a file; empty where it is read."""
    try:
        read()
    except MtpipeError as error:
        assert "\n" not in str(error)  # noqa: PT017
        return str(error)
    return ""


# ------------------------------------------------------------------ look-up tables


def test_a_look_up_table_with_any_other_metadata_is_read_or_told(scan, tmp_path):
    with np.load(scan / "bead1.npz") as file:
        content = dict(file)
    metadata = json.loads(str(content["metadata"]))
    path = tmp_path / "odd.npz"
    told = 0
    for key in metadata:
        for odd in (*ODD, "del"):
            changed = {k: v for k, v in metadata.items() if k != key or odd != "del"}
            if odd != "del":
                changed[key] = odd
            np.savez(path, **content | {"metadata": np.array(json.dumps(changed))})
            message = said(lambda: LookUpTable.load(path).check_region(metadata["region_size_px"]))
            told += bool(message)
            assert not message or "odd.npz" in message or "cannot be compared" in message
    assert told > 0.7 * len(metadata) * (len(ODD) + 1)


def test_a_look_up_table_with_any_other_arrays_is_told(scan, tmp_path):
    with np.load(scan / "bead1.npz") as file:
        content = dict(file)
    path = tmp_path / "odd.npz"
    n, rings = content["profiles"].shape
    for name, odd in {
        "z_nm": [np.zeros(n), np.arange(n)[::-1], np.full(n, np.nan), np.arange(n + 1), "words"],
        "profiles": [np.zeros((n, rings)), np.full((n, rings), np.nan), np.zeros((n, rings + 1)),
                     np.zeros(n), np.zeros((0, 0))],
        "noise": [np.full(n, -1.0), np.full(n, np.inf), np.zeros((n, 2)), np.array(1.0)],
    }.items():  # fmt: skip
        for array in odd:
            np.savez(path, **content | {name: array})
            assert "not a look-up table of mtpipe" in said(lambda: LookUpTable.load(path)), name


def test_a_look_up_table_with_any_byte_changed_is_read_or_told(scan, tmp_path):
    whole = (scan / "bead1.npz").read_bytes()
    path = tmp_path / "odd.npz"
    random = np.random.default_rng(1)
    told = 0
    for at in random.integers(len(whole), size=300):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        told += bool(said(lambda: LookUpTable.load(path)))
    assert told > 150


# ------------------------------------------------------------------ HDF5


def odd_arrays(values):
    """Other datasets than a file should have."""
    yield values[:, None] if values.ndim == 1 else values[:, :2]
    yield values[:-1]
    yield np.array(values.flat[0])
    yield np.array([b"odd"] * len(values))
    yield np.zeros(0)
    yield values.astype(float) + np.nan


def test_a_magscope_file_with_any_other_dataset_is_told(tmp_path):
    path = write_magscope(tmp_path / "whole.h5", magscope_batches(magscope_positions()))
    odd = tmp_path / "Tracking Data 1.h5"
    with h5py.File(path) as file:
        names = [
            name for name in file["tracking"] if isinstance(file["tracking"][name], h5py.Dataset)
        ]
        arrays = {name: file["tracking"][name][()] for name in names}
    told = 0
    for name in names:
        for other in (*odd_arrays(arrays[name]), "group", "nothing"):
            shutil.copy(path, odd)
            with h5py.File(odd, "a") as file:
                del file["tracking"][name]
                if isinstance(other, np.ndarray):
                    file["tracking"][name] = other
                elif other == "group":
                    file["tracking"].create_group(name)
            told += bool(said(lambda: mtpipe.load(odd, preset({"preset": "magscope-hdf5"}))))
    assert told > 0.7 * 8 * len(names)


def test_a_header_may_announce_no_more_than_its_file_holds(tmp_path):
    check_announced(100, 100, packed=False, where="a")
    check_announced(HARMLESS_BYTES, 1, packed=True, where="a")
    for packed in (False, True):
        with pytest.raises(RecordingError, match=r"a: announces 1e\+15 bytes"):
            check_announced(10**15, 1000, packed=packed, where="a")
    path = write_magscope(tmp_path / "whole.h5", magscope_batches(magscope_positions()))
    with h5py.File(path, "a") as file:
        del file["tracking/bead_ids"]
        file["tracking"].create_dataset("bead_ids", (10**12,), "i4", chunks=(1000,))
    assert "announces" in said(lambda: mtpipe.load(path, preset({"preset": "magscope-hdf5"})))


def test_what_does_not_fit_into_the_memory_is_told_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(announced, "memory_bytes", lambda: 1 << 20)
    check_fits(1 << 16, "a")
    with pytest.raises(RecordingError, match=r"a: unfolds to 6\.55e\+04 numbers"):
        check_fits((1 << 16) + 1, "a")
    same = pd.DataFrame({"time_s": np.zeros(100_000), "b1_x_nm": np.zeros(100_000)})
    same.to_parquet(tmp_path / "small.parquet")
    with pytest.raises(RecordingError, match=r"small\.parquet: unfolds to 2e\+05 numbers"):
        next(open_parquet(tmp_path / "small.parquet").batches([0, 1]))
    np.savez_compressed(tmp_path / "small.npz", a=np.zeros(100_000))
    with pytest.raises(RecordingError, match=r"small\.npz: unfolds to 1e\+05 numbers"):
        next(open_arrays(tmp_path / "small.npz", "npz").batches([0]))
    text = tmp_path / "long.csv.gz"
    text.write_bytes(gzip.compress(b"time_s,b1_x_nm,b1_y_nm\n" + b"0,0,0\n" * 30_000))
    assert "numbers, which need" in said(lambda: mtpipe.load(text, setup_of()))
    monkeypatch.setattr(announced, "memory_bytes", lambda: None)
    check_fits(1 << 60, "a")


def hdf5(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("a", data=np.ones(200_000), chunks=(200_000,), compression="gzip")
    return lambda: next(open_arrays(path, "hdf5").batches([0]))


def matlab(path):
    part = np.ones((100_000, 1))
    scipy.io.savemat(path, {"a": part, "b": part}, do_compression=True)
    return lambda: open_arrays(path, "matlab")


def numpy_archive(path):
    np.savez_compressed(path, a=np.ones((1000, 200)))
    return lambda: open_arrays(path, "npz")


def film(path):
    images = np.ones((2, 1000, 1000), np.uint8)
    tifffile.imwrite(path, images, compression="zlib", photometric="minisblack", metadata=None)
    return lambda: open_stack(path)


def run_folder(path):
    path.mkdir()
    folder = write_run_folder(path / "run", plateaus=1)
    pd.DataFrame({"bead": np.zeros(200_000)}).to_parquet(folder / "forces.parquet")
    return lambda: write_report(folder)


@pytest.mark.parametrize("make", [hdf5, matlab, numpy_archive, film, run_folder])
def test_what_unfolds_at_once_to_more_than_the_memory_is_told_first(tmp_path, monkeypatch, make):
    read = make(tmp_path / "small.npz")
    monkeypatch.setattr(announced, "memory_bytes", lambda: 1_500_000)
    with pytest.raises(MtpipeError, match=r"unfolds to .* of memory; there are 0\.0015 GB"):
        read()


def test_parquet_fields_that_unfold_far(tmp_path):
    long = pa.array([np.zeros(20_000)], pa.list_(pa.float64()))
    fixed = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(20_000)), 20_000)
    pq.write_table(pa.table({"a": long, "b": fixed, "t": [1.0]}), tmp_path / "long.parquet")
    table = open_parquet(tmp_path / "long.parquet")
    assert table.names == ("t",)
    assert set(table.unusable) == {"a", "b"}
    # a word of a megabyte that stands in a thousand rows
    words = pa.DictionaryArray.from_arrays(np.zeros(1000, np.int8), ["x" * 1_000_000])
    pq.write_table(pa.table({"t": words}), tmp_path / "words.parquet", store_schema=False)
    with pytest.raises(RecordingError, match="column t holds text"):
        next(open_parquet(tmp_path / "words.parquet").batches([0]))
    assert pa.default_memory_pool().max_memory() < 500_000_000


@pytest.mark.parametrize("first", [True, False])
def test_a_parquet_list_of_which_one_row_is_beyond_the_memory(tmp_path, monkeypatch, first):
    few, long = [[1.0, 2.0]] * 2000, [np.zeros(300_000)]
    rows = long + few if first else few + long
    table = pa.table({"p": pa.array(rows, pa.list_(pa.float64())), "t": np.zeros(2001)})
    pq.write_table(table, tmp_path / "a.parquet")
    monkeypatch.setattr(announced, "memory_bytes", lambda: 4_000_000)
    small = open_parquet(tmp_path / "a.parquet")
    assert small.names == ("t",)
    assert small.unusable == {"p": "2001 rows of list<element: double>"}
    assert sum(len(batch[0]) for batch in small.batches([0])) == 2001


def test_memory_that_other_programs_have_is_told_as_that(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", np.zeros(10))

    def none_left(*_):
        raise MemoryError

    monkeypatch.setattr(arrays, "values_of", none_left)
    with pytest.raises(RecordingError, match=r"a\.npy: needs more memory than is free"):
        next(open_arrays(tmp_path / "a.npy", "npy").batches([0]))


ROWS = b"time_s,b1_x_nm,b1_y_nm\n" + b"0,0,0\n" * 1000


@pytest.mark.parametrize("begin", [b"", b"# ", ROWS])
@pytest.mark.parametrize("piece", [b"0,", b"\0", b"0.5\t"])
def test_text_without_line_ends_is_told_at_its_first_megabytes(tmp_path, monkeypatch, begin, piece):
    path = tmp_path / "endless.csv.gz"
    path.write_bytes(gzip.compress(begin + piece * (1 << 23)))
    read = []
    whole = gzip.GzipFile.read1
    monkeypatch.setattr(
        gzip.GzipFile, "read1", lambda *given: read.append(whole(*given)) or read[-1]
    )
    told = said(lambda: mtpipe.load(path, setup_of()))
    # zero bytes after whole rows are what a file has that was not written to its end
    assert "does not end within 1048576 characters" in told or "ends in zero bytes" in told
    assert 1 << 20 < sum(map(len, read)) < 1 << 23


def test_the_memory_of_a_container_bounds_that_of_the_computer(tmp_path, monkeypatch):
    bound = tmp_path / "memory.max"
    monkeypatch.setattr(announced, "BOUND_OF_CONTAINER", bound)
    whole = announced.memory_bytes()
    for told, expected in (("1000000\n", 1_000_000), ("max\n", whole)):
        bound.write_text(told)
        assert announced.memory_bytes() == expected


# ------------------------------------------------------------------ MATLAB

CONTENT = {
    "time": np.arange(60.0)[:, None],
    "complex": np.ones((5, 2)) + 1j,
    "struct": {"a": 1.0, "b": np.ones((3, 3)), "text": "text"},
    "cell": np.array([np.arange(3), "x", np.zeros((0, 0))], dtype=object),
    "sparse": scipy.sparse.csc_matrix(np.eye(4)),
    "short": np.arange(4, dtype=np.int16),
    "empty": np.zeros((0, 3)),
    "truth": np.array([True, False]),
}


def matlab(packed, content=CONTENT):
    stream = io.BytesIO()
    scipy.io.savemat(stream, content, do_compression=packed)
    return stream.getvalue()


@pytest.mark.parametrize("packed", [False, True])
def test_whatever_scipy_writes_is_sound(packed):
    stream = io.BytesIO(matlab(packed))
    check_matlab(stream)
    assert stream.tell() == 0
    assert set(scipy.io.loadmat(stream)) >= set(CONTENT)
    check_matlab(io.BytesIO(matlab(packed, {"long": np.zeros((200_000, 3))})))


def test_an_array_that_is_called_complex_and_is_not_is_told_before_scipy_reads_it():
    data = bytearray(matlab(False, {"time": np.arange(300.0), "magnet": np.arange(300.0)}))
    flags = 128 + 8 + 8  # the file's header, the array's tag, the tag of its flags
    data[flags + 1] |= 0x08
    with pytest.raises(RecordingError, match="is damaged or cut off: it has"):
        check_matlab(io.BytesIO(bytes(data)))


MUTATE = """
import io, sys, numpy as np, scipy.io
from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.matlab_check import check_matlab
whole = sys.stdin.buffer.read()
random = np.random.default_rng(7)
for _ in range(400):
    data = bytearray(whole)
    for at in random.integers(len(data), size=int(random.integers(1, 4))):
        data[at] = int(random.choice([0, 1, 8, 14, 15, 255, data[at] ^ 1, data[at] ^ 64]))
    stream = io.BytesIO(bytes(data))
    try:
        check_matlab(stream)
    except RecordingError:
        continue
    try:
        scipy.io.loadmat(stream)
    except Exception:
        pass
print("alive")
"""


def test_what_is_let_through_does_not_end_the_process():
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", MUTATE],
        input=matlab(False),
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, b"alive\n"), done.stderr[-500:]


# ------------------------------------------------------------------ the cases


@pytest.mark.skipif(not FAULTS.is_dir(), reason="needs ../shared/cases/faults")
@pytest.mark.parametrize(
    "kind", ["lut", "magscope", "calisto", "calisto_bytes", "matlab", "matlab_segv", "tiff"]
)
def test_the_damaged_files_of_the_cases_are_told(kind):
    setups = {"matlab": "matlab_segv"}
    setup = FAULTS / setups.get(kind, kind) / "setup.toml"
    readers = {"lut": LookUpTable.load, "tiff": open_stack}
    files = [file for file in (FAULTS / kind).iterdir() if file.suffix != ".toml"]
    assert files
    for file in files:
        read = readers.get(kind, lambda path: mtpipe.load(path, setup))
        assert file.name in said(lambda read=read, file=file: read(file)), file.name
