"""Parquet files, read by row groups so that a long recording is never there twice.

A field of several numbers is `field[1]`, `field[2]`, ...; a field within a struct `struct/field`.
What the file says of its columns stands in the metadata of the fields; of all of them in that of
the file or, where pandas wrote it, in pandas' `attrs`.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.announced import NUMBER_BYTES, check_fits, check_room, no_room
from mtpipe.ingest.column_attributes import NOTHING, Stated, stated_by
from mtpipe.ingest.contents import BLOCK_BYTES, MOST_COLUMNS, values_of_text
from mtpipe.setup.source_parts import Layout

MOST_ROWS = 1 << 17
END_MARKS = (b"PAR1", b"PARE")
# Rows at the beginning of a list that say how many numbers it holds; those of lost frames may be
# empty.
ROWS_THAT_TELL = 1000
# Where pandas keeps `attrs`: Arrow's own place, and pandas' with an older Arrow.
PANDAS, PANDAS_ATTRS = b"pandas", b"PANDAS_ATTRS"


@dataclass(frozen=True)
class _Column:
    """One column: its name, the field it is in, what leads to it there, and its type."""

    name: str
    field: str
    path: tuple[str | int, ...]
    kind: pa.DataType
    stated: Stated

    @property
    def is_of_list(self) -> bool:
        """Whether it is one of several numbers."""
        return bool(self.path) and isinstance(self.path[0], int)


@dataclass(frozen=True)
class _Size:
    """Largest sizes of a field: mean values per row, and values and bytes of a row group."""

    values: int
    in_group: int
    held: int


@dataclass(frozen=True)
class ParquetTable:
    """A Parquet file; attributes as in `arrays.ArrayTable`, and sizes of its fields."""

    path: Path
    columns: tuple[_Column, ...]
    sizes: Mapping[str, _Size] = field(repr=False)
    unusable: Mapping[str, str] = field(default_factory=dict)
    as_stated: bool = True
    has_names: bool = True
    guesses: tuple[str, ...] = ()
    remarks: list[str] = field(default_factory=list, compare=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)

    @property
    def stated(self) -> tuple[Stated, ...]:
        """What the file says of each column."""
        return tuple(column.stated for column in self.columns)

    def batches(self, wanted: Sequence[int]) -> Iterator[list[NDArray[Any]]]:
        """Yield the wanted columns (positions from 0) block by block, nulls as NaN.

        Raises
        ------
        RecordingError : a column is no numbers, or the file is damaged.
        """
        chosen = [self.columns[i] for i in wanted]
        fields = list(dict.fromkeys(column.field for column in chosen))
        try:
            with _opened(self.path) as file:
                check_fits(file.metadata.num_rows * len(chosen), str(self.path))
                sizes = [self.sizes[name] for name in fields]
                check_room(sum(size.held for size in sizes), str(self.path))
                # any row of a list may hold all values of its row group, and is read as one
                lists = {column.field for column in chosen if column.is_of_list}
                check_fits(sum(self.sizes[name].in_group for name in lists), str(self.path))
                values = sum(size.values for size in sizes)
                rows = max(1, BLOCK_BYTES // (NUMBER_BYTES * max(1, values)))
                for batch in file.iter_batches(min(rows, MOST_ROWS), columns=fields):
                    yield [self._values(batch.column(c.field), c) for c in chosen]
        except RecordingError:
            raise
        except Exception as error:  # a damaged file raises anything
            raise _damaged(self.path, error) from error

    def _values(self, array: pa.Array, column: _Column) -> NDArray[Any]:
        for step in column.path:
            if isinstance(step, int):  # a shorter list, as of a lost frame, ends in nulls
                padded = pc.list_slice(array, step, step + 1, return_fixed_size_list=True)
                array = pc.list_element(padded, 0)
            else:
                array = pc.struct_field(array, step)
        kind = array.type
        if pa.types.is_timestamp(kind):
            moments = array.cast(pa.timestamp("ns", tz=kind.tz), safe=False)
            return np.asarray(moments.to_numpy(zero_copy_only=False), dtype="datetime64[ns]")
        if pa.types.is_time(kind):
            whole = array.cast(pa.time64("ns"), safe=False).cast(pa.int64())
            return np.asarray(whole.to_numpy(zero_copy_only=False)).astype("datetime64[ns]")
        if pa.types.is_duration(kind):
            whole = array.cast(pa.duration("ns"), safe=False).cast(pa.int64()).cast(pa.float64())
            return np.asarray(whole.to_numpy(zero_copy_only=False)) / 1e9
        if _is_text(kind):
            words = array.dictionary_encode()  # a word may be long, and stand in many rows
            cells = [str(cell or "") for cell in words.dictionary.to_pylist()]
            values = values_of_text(["", *cells])
            if values is None:
                begin = "".join(cells[:1])[:40]
                raise RecordingError(
                    f"column {column.name} holds text ({begin!r}) where numbers or clock times are "
                    "expected",
                    where=str(self.path),
                )
            at = pc.fill_null(words.indices, -1).to_numpy(zero_copy_only=False)
            return np.asarray(values[at + 1])
        raw = array.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        return (column.stated if self.as_stated else NOTHING).physical(raw)


def open_parquet(path: Path, layout: Layout | None = None) -> ParquetTable:
    """Read the names of the columns.

    Raises
    ------
    RecordingError : the file is damaged, cut off, or two columns have one name.
    """
    columns: list[_Column] = []
    unusable: dict[str, str] = {}
    try:
        with _opened(path) as file:
            sizes = _sizes(file)
            around = _of_the_file(file.schema_arrow.metadata or {})
            for one in file.schema_arrow:
                own = _text_of(one.metadata or {})
                for name, steps, kind in _leaves(one, file, sizes[one.name]):
                    if not _is_usable(kind):
                        unusable[name] = f"{file.metadata.num_rows} rows of {kind}"
                        continue
                    stated = NOTHING if _is_time(kind) else stated_by(own).within(around)
                    columns.append(_Column(name, one.name, steps, kind, stated))
    except Exception as error:  # a damaged file raises anything
        raise _damaged(path, error) from error
    names = [column.name for column in columns]
    double = sorted({n for n in names if names.count(n) > 1})
    if double:
        raise RecordingError(f"has two columns named {double[0]!r}", where=str(path))
    as_stated = layout is None or layout.attributes is None
    return ParquetTable(path, tuple(columns), sizes, unusable, as_stated)


def _opened(path: Path) -> pq.ParquetFile:
    """The file, of which text is kept as in it: a word that stands in many rows is there once."""
    with pq.ParquetFile(path) as file:
        _check_metadata(file.metadata, path.stat().st_size)
        flat = [one for one in file.schema if one.path == one.name]
    text = [one.name for one in flat if one.logical_type.type == "STRING"]
    return pq.ParquetFile(path, read_dictionary=text)


class _NothingReadError(Exception):
    """Reading would begin."""


class _Unread(io.RawIOBase):
    """A file that has a size but no content; reading raises."""

    def __init__(self, size: int) -> None:
        self._at, self._size = 0, size

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._at = offset + (self._size if whence == io.SEEK_END else 0)
        return self._at

    def tell(self) -> int:
        return self._at

    def read(self, size: int = -1) -> bytes:
        raise _NothingReadError


def _check_metadata(metadata: pq.FileMetaData, size: int) -> None:
    """Raise what pyarrow says of columns' metadata that contradict themselves.

    It says so only where it is about to read; asked for the metadata it ends the process.
    """
    unread = pq.ParquetFile(_Unread(size), metadata=metadata, buffer_size=1, pre_buffer=False)
    for k in range(metadata.num_row_groups):
        with suppress(_NothingReadError):
            next(unread.iter_batches(1, row_groups=[k], use_threads=False), None)


def _sizes(file: pq.ParquetFile) -> dict[str, _Size]:
    """Sizes of all fields."""
    groups = [file.metadata.row_group(k) for k in range(file.num_row_groups)]
    sizes, first = {}, 0
    for one in file.schema_arrow:
        stop = first + _leaf_count(one.type)
        most = _Size(0, 0, 0)
        for group in groups:
            leaves = [group.column(j) for j in range(first, stop)]
            numbers = sum(leaf.num_values for leaf in leaves)
            held = sum(leaf.total_uncompressed_size for leaf in leaves)
            most = _Size(
                max(most.values, numbers // max(1, group.num_rows)),
                max(most.in_group, numbers),
                max(most.held, held),
            )
        sizes[one.name] = most
        first = stop
    return sizes


def _leaf_count(kind: pa.DataType) -> int:
    """How many columns of Parquet's own a field has."""
    return sum(_leaf_count(kind.field(k).type) for k in range(kind.num_fields)) or 1


def _leaves(
    one: pa.Field, file: pq.ParquetFile, size: _Size
) -> Iterator[tuple[str, tuple[str | int, ...], pa.DataType]]:
    """Name, way and type of every column in a field."""
    if pa.types.is_struct(one.type):
        for inner in one.type:
            yield f"{one.name}/{inner.name}", (inner.name,), inner.type
        return
    length = 0
    if pa.types.is_fixed_size_list(one.type):
        length = one.type.list_size
    elif pa.types.is_list(one.type) or pa.types.is_large_list(one.type):
        length = _length(one.name, file, size)
    if not 0 < length <= MOST_COLUMNS:
        yield one.name, (), one.type
    for k in range(length if length <= MOST_COLUMNS else 0):
        yield f"{one.name}[{k + 1}]", (k,), one.type.value_type


def _length(name: str, file: pq.ParquetFile, size: _Size) -> int:
    """Numbers in the longest of the first lists of a field; 0 if they are too long to be read."""
    if size.values > MOST_COLUMNS:
        return 0
    try:
        check_fits(size.in_group, "")
    except RecordingError:
        return 0
    first = next(file.iter_batches(ROWS_THAT_TELL, columns=[name]), None)
    return 0 if first is None else pc.max(pc.list_value_length(first.column(0))).as_py() or 0


def _of_the_file(metadata: Mapping[bytes, bytes]) -> Stated:
    of_pandas = (PANDAS, PANDAS_ATTRS)
    own = _text_of({k: v for k, v in metadata.items() if k not in of_pandas and b":" not in k})
    with suppress(ValueError, AttributeError, TypeError):  # what is no JSON says nothing
        own |= json.loads(metadata.get(PANDAS_ATTRS, b"{}"))
    with suppress(ValueError, AttributeError, TypeError):
        own |= json.loads(metadata.get(PANDAS, b"{}")).get("attributes") or {}
    return stated_by(own, where="the file")


def _text_of(metadata: Mapping[bytes, bytes]) -> dict[str, Any]:
    return {k.decode("utf-8", "replace"): v.decode("utf-8", "replace") for k, v in metadata.items()}


def _is_text(kind: pa.DataType) -> bool:
    value = kind.value_type if pa.types.is_dictionary(kind) else kind
    return bool(pa.types.is_string(value) or pa.types.is_large_string(value))


def _is_time(kind: pa.DataType) -> bool:
    return bool(pa.types.is_timestamp(kind) or pa.types.is_time(kind) or pa.types.is_duration(kind))


def _is_usable(kind: pa.DataType) -> bool:
    numbers = pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_null(kind)
    return bool(numbers or pa.types.is_decimal(kind) or _is_time(kind) or _is_text(kind))


def _damaged(path: Path, error: Exception) -> RecordingError:
    if isinstance(error, MemoryError):
        return no_room(str(path))
    with path.open("rb") as stream:
        stream.seek(max(0, path.stat().st_size - 4))
        whole = stream.read() in END_MARKS
    if not whole:
        return RecordingError(
            "is cut off or damaged: its end, where a Parquet file says what is in it, is missing, "
            "so nothing can be taken from it",
            where=str(path),
            mend="Copy the file again.",
        )
    reason = f"{type(error).__name__}: {error}".splitlines()[0][:200]
    return RecordingError(f"is damaged ({reason})", where=str(path))
