"""Files that hold arrays: MATLAB v5, HDF5, LabVIEW TDMS, npz, PicoTwist plots.

Each is presented as a table of one-dimensional columns with names. An array `a` of two dimensions
becomes `a[1]`, `a[2]`, ... along its shorter side, as frames are its longer one; an array of
records (a PyTables table) becomes `a/field`. Names in HDF5 are full paths without the leading
slash; in TDMS `group/channel`, or the channel alone where the file has one group.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import IO, Any, BinaryIO, cast

import numpy as np

from mtpipe.errors import RecordingError
from mtpipe.ingest.announced import check_announced, check_fits
from mtpipe.ingest.files import open_stream
from mtpipe.ingest.gr import read_gr
from mtpipe.ingest.matlab_check import check_matlab
from mtpipe.ingest.source import Format
from mtpipe.recording import FloatArray

BLOCK_ROWS = 1 << 18
NUMERIC = "biuf"
Getter = Callable[[int, int], Any]  # rows [start, stop) of one column


@dataclass(frozen=True)
class Column:
    """One column: its name, length, and how to get a piece of it."""

    name: str
    rows: int
    get: Getter


@dataclass(frozen=True)
class ArrayTable:
    """A file of arrays seen as a table.

    `names` and `has_names` as in `text.TextTable`; nothing about it is guessed.
    """

    path: Path
    names: tuple[str, ...]
    kind: Format
    has_names: bool = True
    guesses: tuple[str, ...] = ()

    def batches(self, wanted: Sequence[int]) -> Iterator[list[FloatArray]]:
        """Yield the wanted columns (positions from 0) piece by piece as float64.

        Raises
        ------
        RecordingError : columns of different length, or damage.
        """
        try:
            with _open(self.path, self.kind) as columns:
                chosen = [columns[i] for i in wanted]
                lengths = {c.rows for c in chosen}
                if len(lengths) > 1:
                    told = ", ".join(f"{c.name}: {c.rows}" for c in chosen)
                    raise RecordingError(
                        f"columns differ in length ({told[:300]})", where=str(self.path)
                    )
                n = max(lengths, default=0)
                check_fits(n * len(chosen), str(self.path))
                for start in range(0, n, BLOCK_ROWS):
                    stop = min(start + BLOCK_ROWS, n)
                    yield [np.asarray(c.get(start, stop), dtype=np.float64) for c in chosen]
        except RecordingError as error:
            error.where = str(self.path)
            raise
        except Exception as error:  # the libraries raise anything on a damaged file
            raise _damaged(self.path, self.kind, error) from error


def open_arrays(path: Path, kind: Format) -> ArrayTable:
    """List the columns of a file of arrays.

    Raises
    ------
    RecordingError : the file is damaged, not of this kind, or holds no numbers.
    """
    try:
        with _open(path, kind) as columns:
            names = tuple(c.name for c in columns)
    except RecordingError as error:
        error.where = str(path)
        raise
    except Exception as error:  # the libraries raise anything on a damaged file
        raise _damaged(path, kind, error) from error
    if not names:
        raise RecordingError(f"holds no arrays of numbers ({kind})", where=str(path))
    return ArrayTable(path, names, kind)


def _damaged(path: Path, kind: Format, error: Exception) -> RecordingError:
    reason = f"{type(error).__name__}: {error}".splitlines()[0][:200]
    return RecordingError(f"cannot be read as {kind} ({reason})", where=str(path))


@contextmanager
def _open(path: Path, kind: Format) -> Iterator[list[Column]]:
    openers = {"matlab": _matlab, "hdf5": _hdf5, "tdms": _tdms, "npz": _npz, "gr": _gr}
    with ExitStack() as stack:
        stream = stack.enter_context(open_stream(path))
        if not stream.name:
            stream = io.BytesIO(stream.read())  # gzipped: these formats jump about in the file
        yield openers[kind](stream, stack)


def _matlab(stream: BinaryIO, stack: ExitStack) -> list[Column]:
    import scipy.io

    check_matlab(stream)
    content: dict[str, Any] = scipy.io.loadmat(cast(Any, stream), chars_as_strings=False)
    columns: list[Column] = []
    for name, value in content.items():
        if isinstance(value, np.ndarray) and not name.startswith("__"):
            columns += _expand(name, value.shape, value.dtype, value.__getitem__)
    return columns


def _hdf5(stream: BinaryIO, stack: ExitStack) -> list[Column]:
    import h5py

    file = stack.enter_context(h5py.File(stream, "r"))
    columns: list[Column] = []

    def visit(name: str | bytes, node: object) -> None:
        if isinstance(node, h5py.Dataset) and node.shape:
            known = name if isinstance(name, str) else name.decode("utf-8", "replace")
            columns.extend(_expand(known, node.shape, node.dtype, partial(_held, node)))

    file.visititems(visit)
    return columns


def _held(node: Any, index: Any) -> Any:
    """Part of a dataset of HDF5, whose numbers are in the file as its header says."""
    if not node.is_virtual and not node.external:
        announced = node.size * node.dtype.itemsize
        check_announced(announced, node.id.get_storage_size(), node.chunks is not None, node.name)
    return node[index]


def _tdms(stream: BinaryIO, stack: ExitStack) -> list[Column]:
    import nptdms

    file = stack.enter_context(nptdms.TdmsFile.open(stream))
    alone = len(file.groups()) == 1
    columns: list[Column] = []
    for group in file.groups():
        for channel in group.channels():
            name = channel.name if alone else f"{group.name}/{channel.name}"
            shape = (len(channel),)
            columns += _expand(name, shape, np.dtype(channel.dtype), channel.__getitem__)
    return columns


def _gr(stream: BinaryIO, stack: ExitStack) -> list[Column]:
    columns: list[Column] = []
    for name, values in read_gr(stream).items():
        columns += _expand(name, values.shape, values.dtype, values.__getitem__)
    return columns


def _npz(stream: BinaryIO, stack: ExitStack) -> list[Column]:
    archive = stack.enter_context(np.load(stream, allow_pickle=False))
    columns: list[Column] = []
    for member in archive.zip.namelist():
        with archive.zip.open(member) as piece:
            old = np.lib.format.read_magic(piece) == (1, 0)
            read = np.lib.format.read_array_header_1_0 if old else _npy_header_2
            shape, _, dtype = read(piece)
        name = member.removesuffix(".npy")
        whole = cache(partial(archive.__getitem__, name))
        columns += _expand(name, shape, dtype, partial(_indexed, whole))
    return columns


def _npy_header_2(piece: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    return np.lib.format.read_array_header_2_0(piece)


def _expand(
    name: str, shape: tuple[int, ...], dtype: np.dtype[Any], get: Callable[[Any], Any]
) -> list[Column]:
    """The columns of one array; none of what is no table of numbers."""
    if dtype.names is not None and len(shape) == 1:
        fields = [f for f in dtype.names if dtype[f].kind in NUMERIC and not dtype[f].shape]
        return [Column(f"{name}/{f}", shape[0], partial(_field, get, f)) for f in fields]
    if dtype.kind not in NUMERIC or 0 in shape or len(shape) not in (1, 2):
        return []
    if len(shape) == 1:
        return [Column(name, shape[0], partial(_piece, get))]
    get_one = _of_columns if shape[0] >= shape[1] else _of_rows
    across = min(shape)
    labels = [name] if across == 1 else [f"{name}[{k + 1}]" for k in range(across)]
    return [Column(label, max(shape), partial(get_one, get, k)) for k, label in enumerate(labels)]


def _indexed(whole: Callable[[], Any], index: Any) -> Any:
    return whole()[index]


def _piece(get: Callable[[Any], Any], start: int, stop: int) -> Any:
    return get(slice(start, stop))


def _field(get: Callable[[Any], Any], field: str, start: int, stop: int) -> Any:
    return get(slice(start, stop))[field]


def _of_columns(get: Callable[[Any], Any], k: int, start: int, stop: int) -> Any:
    return get((slice(start, stop), k))


def _of_rows(get: Callable[[Any], Any], k: int, start: int, stop: int) -> Any:
    return get((k, slice(start, stop)))
