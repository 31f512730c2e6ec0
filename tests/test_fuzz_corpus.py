"""Inputs that once ended in no sentence (workflows/fuzz), and a quick round of all readers."""

import gzip
import io
import json
import re
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter

import mtpipe
from mtpipe.ground.errors import MtpipeError, RecordingError, SetupError
from mtpipe.ground.files import in_one_line
from mtpipe.ground.notice import Notice
from mtpipe.ingest import announced
from mtpipe.ingest.arrays import open_arrays
from mtpipe.ingest.bounded import BoundedReader
from mtpipe.ingest.cells import is_number
from mtpipe.ingest.data_files import open_stream
from mtpipe.ingest.matlab_check import check_matlab
from mtpipe.ingest.parquet import open_parquet
from mtpipe.report import write_report
from mtpipe.report.folder import RunFolderError, _read_table
from mtpipe.setup.setup import read_setup
from mtpipe.tracking.lookup_table import LookUpTable
from tests.ingest_recordings import five_setup
from tests.report_beads import RUN
from tests.report_folder import write_run_folder

pytestmark = pytest.mark.slow

STUDY = Path(__file__).parents[1] / "workflows" / "fuzz" / "study.py"


def test_every_reader_ends_thirty_inputs_fine_or_with_a_sentence(tmp_path):
    done = subprocess.run(
        [sys.executable, str(STUDY), "--inputs", "30", "--state", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    assert len(re.findall(r"^\| \w+ \| 30 \|", done.stdout, re.MULTILINE)) == 13


# ------------------------------------------------------------------ names


@pytest.mark.parametrize("sign", ["\n", "\r\n", "\x0b", "\x85", "\u2028", "\x1b[31m"])
def test_a_sentence_is_one_line_whatever_is_named_in_it(sign):
    error = MtpipeError(f"no a{sign}b", where=f"c{sign}d", mend=f"Name e{sign}f.")
    error.where = f"g{sign}h"  # as where a file's name is added later
    notice = Notice("code", "info", f"no a{sign}b")
    for said in (str(error), error.message, notice.message):
        assert said.splitlines() == [said]
        assert said.isprintable()
    assert in_one_line("µm, 20 °C, \u00a0, 名") == "µm, 20 °C, \u00a0, 名"


# ------------------------------------------------------------------ setups


@pytest.mark.parametrize(
    ("text", "said"),
    [("a = " + "[" * 5000, "nested too deeply"), ("a = " + "9" * 5000, "not valid TOML")],
)
def test_toml_that_python_does_not_take_is_told(tmp_path, text, said):
    (tmp_path / "setup.toml").write_text(text)
    with pytest.raises(SetupError, match=said):
        read_setup(tmp_path / "setup.toml")


# ------------------------------------------------------------------ cells


def test_a_cell_of_many_digits_is_looked_at_once():
    """In time that grows with the square of their number this test would take minutes."""
    assert is_number("1" * 200_000, ".")
    assert not is_number("1" * 200_000 + "x", ".")
    assert [is_number(cell, ".") for cell in ("1.", ".5", "1.5e3", ".", "1..5", "")] == [
        *(True, True, True),
        *(False, False, False),
    ]


# ------------------------------------------------------------------ lengths


def test_no_more_is_read_than_a_file_holds(tmp_path):
    (tmp_path / "a").write_bytes(b"abcdef")
    with open_stream(tmp_path / "a") as stream:
        assert isinstance(stream, BoundedReader)
        assert stream.read(2) == b"ab"
        assert stream.read(1 << 62) == b"cdef"
        assert stream.read(1 << 62) == b""
        stream.seek(0)
        assert stream.read() == b"abcdef"


def test_tdms_that_announces_more_scales_than_it_states_is_told(tmp_path):
    path = tmp_path / "r.tdms"
    with TdmsWriter(path) as writer:
        scales = {"NI_Number_Of_Scales": 2**31 - 1}
        writer.write_segment([ChannelObject("data", "X", np.arange(9.0), scales)])
    with pytest.raises(RecordingError, match="announces 2147483647 scales"):
        open_arrays(path, "tdms")


@pytest.mark.parametrize("name", ["r.npz", "lut.npz"])
def test_an_archive_that_announces_more_than_it_holds_is_told(tmp_path, name):
    stream = io.BytesIO()
    np.savez(stream, Time=np.arange(60.0))
    content = bytearray(stream.getvalue())
    at = content.index(b"PK\x01\x02") + 20  # packed and unpacked size, in the archive's index
    content[at : at + 8] = b"\x00\x00\x00\xf0" * 2
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=rf"{name}.*announces 4026531840 bytes"):
        LookUpTable.load(tmp_path / name) if name == "lut.npz" else open_arrays(
            tmp_path / name, "npz"
        )


@pytest.mark.parametrize("column", ["X", "Y"])
def test_parquet_metadata_that_contradict_themselves_are_told(tmp_path, column):
    """pyarrow ends the process where it is asked for them."""
    stream = io.BytesIO()
    pq.write_table(pa.table({"X": np.arange(60.0), "Y": np.arange(60.0)}), stream)
    optional = b"\x15\x0a\x25\x02\x18\x01" + column.encode()  # a column of the schema
    assert stream.getvalue().count(optional) == 1
    required = optional.replace(b"\x02", b"\x00")
    path = tmp_path / "r.parquet"
    path.write_bytes(stream.getvalue().replace(optional, required))
    with pytest.raises(RecordingError, match=r"is damaged .*histogram size mismatch"):
        open_parquet(path)


@pytest.mark.parametrize("packed", [False, True])
def test_numbers_longer_than_their_matlab_array_are_told(packed):
    stream = io.BytesIO()
    scipy.io.savemat(stream, {"X": np.arange(60.0)})
    content = bytearray(stream.getvalue())
    at = len(content) - 480 - 4  # the length of the numbers, before them
    content[at : at + 4] = b"\x00\x00\x00\xf0"
    if packed:
        array = zlib.compress(content[128:])
        content[128:] = struct.pack("<II", 15, len(array)) + array
    with pytest.raises(RecordingError, match="an element of 4026531840 bytes in an array of 5"):
        check_matlab(io.BytesIO(content))


def test_more_matlab_cells_than_there_are_is_told():
    """scipy takes room for all of them before it reads the first."""
    stream, cells = io.BytesIO(), np.empty((5, 1), dtype=object)
    cells[:] = [[1.0]] * 5
    scipy.io.savemat(stream, {"C": cells})
    check_matlab(stream)
    content = bytearray(stream.getvalue())
    at = content.index(struct.pack("<IIii", 5, 8, 5, 1)) + 8  # the sizes, after their tag
    content[at : at + 4] = struct.pack("<i", 738_197_509)
    with pytest.raises(RecordingError, match="of 738197509 cells or structs that holds 5"):
        check_matlab(io.BytesIO(content))


def test_a_packed_file_that_unfolds_to_more_than_the_memory_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(announced, "memory_bytes", lambda: 1 << 20)
    np.save(tmp_path / "r.npy", np.zeros(100_000))
    (tmp_path / "r.gz").write_bytes(gzip.compress((tmp_path / "r.npy").read_bytes()))
    with pytest.raises(RecordingError, match=r"r\.gz: unfolds to 1e\+05 numbers"):
        open_arrays(tmp_path / "r.gz", "npy")


# ------------------------------------------------------------------ HDF5


def test_a_virtual_dataset_of_itself_is_told(tmp_path):
    """HDF5 follows it until the process ends, so it is read in one of its own."""
    path = tmp_path / "r.h5"
    with h5py.File(path, "w") as file:
        for name, source in (("X", "Y"), ("Y", "X"), ("Z", "plain"), ("%s", "%%s")):
            layout = h5py.VirtualLayout((60,), "f8")
            layout[:] = h5py.VirtualSource(".", source, (60,))
            file.create_virtual_dataset(name, layout)
        file["plain"] = np.arange(60.0)
    read = "import sys, mtpipe.ingest.arrays as a; t = a.open_arrays(sys.argv[1], 'hdf5'); "
    read += "print(t.names, sorted(t.unusable)); print(len(list(t.batches([0, 1]))[0][0]))"
    done = subprocess.run(
        [sys.executable, "-c", read, str(path)], capture_output=True, text=True, check=False
    )
    assert done.stdout == "('Z', 'plain') ['%s', 'X', 'Y']\n60\n", done.stderr[-500:]


def test_an_hdf5_name_that_is_no_utf_8_is_shown(tmp_path):
    path = tmp_path / "r.h5"
    with h5py.File(path, "w") as file:
        file["Time"] = file["X"] = np.arange(60.0)
    path.write_bytes(path.read_bytes().replace(b"Time\0", b"Tim\xff\0"))
    table = open_arrays(path, "hdf5")
    assert (table.names, list(table.unusable)) == (("X",), ["Tim\N{REPLACEMENT CHARACTER}"])


@pytest.mark.parametrize("object_number", [0, 7])
def test_a_heap_of_text_that_goes_round_and_round_is_told(tmp_path, object_number):
    """HDF5 never comes back from one, so it is read in a process of its own."""
    path = tmp_path / "r.h5"
    with h5py.File(path, "w") as file:
        file["X"] = np.arange(60.0)
        file["X"].attrs["words"] = ["one", "two"]
    content = bytearray(path.read_bytes())
    at = content.index(b"GCOL") + 16  # its first object: number, and size (8 bytes on)
    content[at : at + 2] = object_number.to_bytes(2, "little")
    content[at + 8 : at + 16] = bytes(8) if object_number == 0 else b"\xf0" + b"\xff" * 7
    path.write_bytes(content)
    read = "import sys, mtpipe.ingest.arrays as a; a.open_arrays(sys.argv[1], 'hdf5')"
    done = subprocess.run(
        [sys.executable, "-c", read, str(path)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert "is damaged: the heap of text at byte" in done.stderr


# ------------------------------------------------------------------ run folders


@pytest.mark.parametrize("as_index", [False, True])
def test_a_table_whose_text_is_no_utf_8_is_told(tmp_path, as_index):
    ends = pa.py_buffer(np.arange(4, dtype="i4"))
    text = pa.Array.from_buffers(pa.string(), 3, [None, ends, pa.py_buffer(b"\xff" * 3)])
    frame = pd.DataFrame({"bead": ["a", "b", "c"], "used": [True] * 3})
    table = pa.Table.from_pandas(frame.set_index("bead") if as_index else frame)
    k = table.column_names.index("bead")
    pq.write_table(table.set_column(k, "bead", text), tmp_path / "a.parquet")
    with pytest.raises(RunFolderError, match=r"a\.parquet: "):
        _read_table(tmp_path / "a.parquet", ("bead", "used"))


def test_a_column_with_a_line_end_in_its_name_is_told_in_one_line(tmp_path):
    np.savez(tmp_path / "r.npz", **{"a\nb": np.arange(60.0)})
    with pytest.raises(RecordingError) as told:
        mtpipe.load(tmp_path / "r.npz", five_setup())
    assert "a\\nb" in str(told.value)
    assert len(str(told.value).splitlines()) == 1


# ------------------------------------------------------------------ run folders


def _huge_ratio(folder):
    path = folder / "details" / "spectra.parquet"
    table = pd.read_parquet(path)
    for row, power, model in ((0, 1e29, 1e-278), (1, 1e-278, 1e29)):
        table.loc[row, ["power_nm2_per_hz", "model_nm2_per_hz"]] = [power, model]
    table.attrs["run"] = RUN
    table.to_parquet(path)


def _long_integer(folder):
    path = folder / "details" / "before_after.json"
    content = json.loads(path.read_text())
    for bead in content["beads"].values():
        for one in bead["spectra"]:
            one["ordinates"][0] = 10**25
    path.write_text(json.dumps(content))


def _no_band(folder):
    path = folder / "details" / "unexplained.json"
    content = json.loads(path.read_text())
    for bead in content["beads"].values():
        for shape in bead["shapes"]:
            for key in ("curve", "curve_low", "curve_high", "value", "value_low", "value_high"):
                shape[key] = [None] * len(shape[key])
    path.write_text(json.dumps(content))


@pytest.mark.parametrize("odd", [_huge_ratio, _long_integer, _no_band])
def test_numbers_of_a_run_folder_that_numpy_takes_for_objects_or_for_nothing_are_drawn(
    tmp_path, odd
):
    folder = write_run_folder(tmp_path / "run", plateaus=2)
    odd(folder)
    assert write_report(folder).is_file()
