"""Files that hold arrays: Parquet, MATLAB v5, HDF5, LabVIEW TDMS, npz.

Each is presented as a table of one-dimensional columns with names. An array `a` of two dimensions
becomes `a[1]`, `a[2]`, ... along its shorter side, as frames are its longer one; an array of
records (a PyTables table) becomes `a/field`. Names in HDF5 are full paths without the leading
slash; in TDMS `group/channel`, or the channel alone where the file has one group.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from mtpipe.errors import RecordingError
from mtpipe.ingest.files import open_stream
from mtpipe.ingest.source import Format
from mtpipe.recording import FloatArray

BLOCK_ROWS = 1 << 18
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
                for start in range(0, n, BLOCK_ROWS):
                    stop = min(start + BLOCK_ROWS, n)
                    yield [np.asarray(c.get(start, stop), dtype=np.float64) for c in chosen]
        except RecordingError:
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
    except Exception as error:  # the libraries raise anything on a damaged file
        raise _damaged(path, kind, error) from error
    if not names:
        raise RecordingError(f"holds no arrays of numbers ({kind})", where=str(path))
    return ArrayTable(path, names, kind)


def _damaged(path: Path, kind: Format, error: Exception) -> RecordingError:
    reason = f"{type(error).__name__}: {error}".splitlines()[0][:200]
    return RecordingError(f"cannot be read as {kind} ({reason})", where=str(path))


def _open(path: Path, kind: Format) -> AbstractContextManager[list[Column]]:
    stream = open_stream(path)
    if isinstance(stream, io.BufferedReader) and not isinstance(stream.raw, io.FileIO):
        with stream:  # gzipped: these formats jump about in the file
            stream = io.BytesIO(stream.read())
    openers = {"parquet": _parquet, "matlab": _matlab, "hdf5": _hdf5, "tdms": _tdms, "npz": _npz}
    return _Opened(stream, openers[kind])


class _Opened(AbstractContextManager[list[Column]]):
    """Columns of a stream that is closed afterwards."""

    def __init__(self, stream: BinaryIO, opener: Callable[[BinaryIO], list[Column]]) -> None:
        self._stream = stream
        self._opener = opener

    def __enter__(self) -> list[Column]:
        try:
            return self._opener(self._stream)
        except BaseException:
            self._stream.close()
            raise

    def __exit__(self, *error: object) -> None:
        self._stream.close()
