"""What a file of arrays holds: its columns, and what in it is no column, and why.

An array `a` of several dimensions is a table whose rows are frames, along its longest side; its
columns are `a[1]`, `a[2]`, ... in two dimensions and `a[1,1]`, `a[1,2]`, ... in three. An array of
records has the columns `a/field`, and `a/field[k]` where a field holds several numbers. A block of
rows is read once for all columns of its array.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.cells import is_number, values_of_cells
from mtpipe.ingest.column_attributes import NOTHING, Stated, stated_by
from mtpipe.ingest.instants import is_instant
from mtpipe.ingest.singles import with_singles

NUMERIC, TIMES, TEXT = "biuf", "mM", "SUO"
BLOCK_BYTES = 1 << 26
# An array with more values a frame than this is a stack of images and no table.
MOST_COLUMNS = 10_000
# Text is looked at this far to tell whether it is numbers or clock times.
TEXT_ROWS = 20
Index = tuple[int | slice, ...]


@dataclass(frozen=True)
class Column:
    """One column of an array: its name, where it stands in a row, and what the file says of it."""

    name: str
    path: tuple[str | tuple[int, ...], ...]
    stated: Stated = NOTHING
    is_text: bool = False


@dataclass(frozen=True)
class Array:
    """An array with its rows along one side.

    Attributes
    ----------
    rows : how many there are; of a file that is cut off, how many are whole.
    row_bytes : size of a row.
    chunk_rows : rows that the file keeps together and that are best read together.
    read : yields rows [start, stop), rows first, of the columns that stand between two places.
    """

    columns: tuple[Column, ...]
    rows: int
    row_bytes: int
    chunk_rows: int
    read: Callable[[int, int, Sequence[Column]], list[NDArray[Any]]]


@dataclass
class Contents:
    """Columns and the rest of a file, while it is looked through.

    `unusable` says of each thing that is no column what it is; `singles` are single values by
    name, a number's unit behind it; `cut` is a sentence about a file that is cut off.
    """

    arrays: list[Array] = field(default_factory=list)
    unusable: dict[str, str] = field(default_factory=dict)
    singles: dict[str, Any] = field(default_factory=dict)
    cut: str = ""

    def stated(self) -> tuple[Stated, ...]:
        """What the file says of all columns, the rates in its single values included."""
        columns = [column for _, column in self.columns()]
        names, stated = [one.name for one in columns], [one.stated for one in columns]
        return tuple(with_singles(names, stated, self.singles))

    def columns(self) -> Iterator[tuple[Array, Column]]:
        """All columns with the array that each is of."""
        for array in self.arrays:
            for column in array.columns:
                yield array, column

    def add_text(self, name: str, text: str) -> None:
        """Add a piece of text."""
        self.singles[name] = text
        self.unusable[name] = f"text ({text[:40]!r})"

    def add(
        self,
        name: str,
        shape: tuple[int, ...],
        dtype: np.dtype[Any],
        get: Callable[[Any], Any],
        attributes: Mapping[str, Any] | None = None,
        *,
        around: Stated = NOTHING,
        chunk: Sequence[int] | None = None,
        whole_rows: int | None = None,
    ) -> None:
        """Add the columns of an array, or say why it has none.

        Parameters
        ----------
        get : the array's values at an index of numpy's.
        attributes : what the file says of it; `around`: what its surroundings say.
        chunk : sides of the pieces in which the file keeps it.
        whole_rows : number of rows before the place where the file is cut off.
        """
        if math.prod(shape) == 1:
            self._add_single(name, dtype, get((0,) * len(shape)), stated_by(attributes or {}).unit)
        if not shape or 0 in shape:
            self.unusable[name] = "empty" if 0 in shape else _single(dtype, get)
            return
        side = int(np.argmax(shape))
        across = shape[:side] + shape[side + 1 :]
        if math.prod(across) > MOST_COLUMNS:
            self.unusable[name] = f"{_told(shape, dtype)}: more values a frame than a table has"
            return
        records = dtype.names is not None
        fields = list(_fields(name, dtype)) if records else [(name, dtype, _index(across), ())]
        found: list[Column] = []
        for at, (label, one, indices, path) in enumerate(fields):
            if records and math.prod(across) > 1:
                self.unusable[label] = f"{_told(shape, one)} of records"
                continue
            text = one.kind in TEXT and _is_values(get, shape, side, path)
            if one.kind not in NUMERIC + TIMES and not text:
                self.unusable[label] = _told(shape, one)
                continue
            for k, index in enumerate(indices):
                place = (at, len(fields)) if records else (k, len(indices))
                stated = stated_by(_of_each(attributes or {}, records), place).within(around)
                number = ",".join(str(i + 1) for i in index)
                called = f"{label}[{number}]" if len(indices) > 1 else label
                found.append(Column(called, (*path, index), stated, text))
        if not found:
            return
        self.arrays.append(
            Array(
                columns=tuple(found),
                rows=shape[side] if whole_rows is None else min(whole_rows, shape[side]),
                row_bytes=max(1, math.prod(across) * dtype.itemsize),
                chunk_rows=1 if chunk is None else chunk[side],
                read=_reader(get, len(shape), side, plain=not records),
            )
        )

    def _add_single(self, name: str, dtype: np.dtype[Any], value: Any, unit: str) -> None:
        for key in dtype.names or ():
            self._add_single(f"{name}/{key}", dtype[key], value[key], "")
        if dtype.kind in NUMERIC + TEXT and np.ndim(value) == 0:
            words = as_text(value)[0] if dtype.kind in TEXT else value
            self.singles[name] = f"{words} {unit}".strip()


def _of_each(attributes: Mapping[str, Any], records: bool) -> Mapping[str, Any]:
    """Attributes that speak of columns: of records those that have a value for each field."""
    if not records:
        return attributes
    return {name: value for name, value in attributes.items() if np.size(value) > 1}


def _index(shape: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [tuple(int(i) for i in index) for index in np.ndindex(*shape)]


def _fields(
    name: str, dtype: np.dtype[Any], path: tuple[str, ...] = ()
) -> Iterator[tuple[str, np.dtype[Any], list[tuple[int, ...]], tuple[str, ...]]]:
    """Fields of records, those of records within records included."""
    for key in dtype.names or ():
        one = dtype[key]
        label, inner = f"{name}/{key}" if name else key, (*path, key)
        if one.names is not None:
            yield from _fields(label, one, inner)
        else:
            yield label, one.base, _index(one.shape), inner


def _reader(
    get: Callable[[Any], Any], dimensions: int, side: int, *, plain: bool
) -> Callable[[int, int, Sequence[Column]], list[NDArray[Any]]]:
    def read(start: int, stop: int, columns: Sequence[Column]) -> list[NDArray[Any]]:
        rows: Index = tuple(slice(start, stop) if k == side else 0 for k in range(dimensions))
        if not plain:
            # sides of one row or column fall away with the index 0
            records = get(rows)
            return [_followed(records, column.path) for column in columns]
        indices = np.array([column.path[-1] for column in columns], dtype=np.int64)
        first, last = indices.min(axis=0), indices.max(axis=0)
        box = [slice(int(a), int(b) + 1) for a, b in zip(first, last, strict=True)]
        box.insert(side, slice(start, stop))
        block = np.moveaxis(np.asarray(get(tuple(box))), side, 0)
        return [block[(slice(None), *(index - first))] for index in indices]

    return read


def _followed(records: NDArray[Any], path: tuple[str | tuple[int, ...], ...]) -> NDArray[Any]:
    *fields, index = path
    for key in fields:
        records = records[key]
    return records[(slice(None), *index)]


def _is_values(
    get: Callable[[Any], Any],
    shape: tuple[int, ...],
    side: int,
    path: tuple[str, ...],
) -> bool:
    """Whether text is numbers or clock times."""
    if math.prod(shape) != shape[side]:
        return False
    values = get(tuple(slice(0, TEXT_ROWS) if k == side else 0 for k in range(len(shape))))
    for key in path:
        values = values[key]
    cells = as_text(values)
    return (
        any(is_number(c, ".") or is_instant(c) for c in cells) and values_of_text(cells) is not None
    )


def as_text(values: Any) -> list[str]:
    """Text of an array of text, in which HDF5 has bytes."""
    return [
        v.decode("utf-8", "replace") if isinstance(v, bytes) else v if isinstance(v, str) else ""
        for v in np.ravel(values).tolist()
    ]


def values_of_text(cells: Sequence[str]) -> NDArray[Any] | None:
    """Numbers or clock times (n,) of text; None if some of it is neither and says no lack."""
    text = pa.chunked_array([pa.array(cells, pa.string())])
    return values_of_cells(text, ".", ())


def values_of(raw: NDArray[Any], column: Column, stated: Stated) -> NDArray[Any]:
    """A block of a column as float64 in the column's unit, or as datetime64[ns]."""
    if column.is_text:
        values = values_of_text(as_text(raw))
        if values is None:
            raise RecordingError(f"column {column.name} holds text where numbers are expected")
        return values
    if raw.dtype.kind == "M":
        return raw.astype("datetime64[ns]")
    if raw.dtype.kind == "m":
        return np.where(np.isnat(raw), np.nan, raw.astype("timedelta64[ns]").astype(float) / 1e9)
    return stated.physical(raw)


def _single(dtype: np.dtype[Any], get: Callable[[Any], Any]) -> str:
    """What a single value is, a number with its value."""
    number = f" ({float(get(()))!r})" if dtype.kind in NUMERIC else ""
    return f"a single {_kind(dtype)}{number}"


def _told(shape: tuple[int, ...], dtype: np.dtype[Any]) -> str:
    return f"{' × '.join(str(n) for n in shape)} {_kind(dtype)}"


def _kind(dtype: np.dtype[Any]) -> str:
    words = {"S": "text", "U": "text", "O": "text or objects", "c": "complex", "V": "opaque"}
    return words.get(dtype.kind, str(dtype))
