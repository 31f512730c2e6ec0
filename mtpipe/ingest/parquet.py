"""Parquet files, read by row groups so that a long recording is never there twice.

A field of several numbers is `field[1]`, `field[2]`, ...; a field within a struct `struct/field`.
What the file says of its columns stands in the metadata of the fields; of all of them in that of
the file or, where pandas wrote it, in pandas' `attrs`.
"""

from __future__ import annotations

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
PANDAS = b"pandas"


@dataclass(frozen=True)
class _Column:
    """One column: its name, the field it is in, what leads to it there, and its type."""

    name: str
    field: str
    path: tuple[str | int, ...]
    kind: pa.DataType
    stated: Stated


@dataclass(frozen=True)
class ParquetTable:
    """A Parquet file; attributes as in `arrays.ArrayTable`."""

    path: Path
    columns: tuple[_Column, ...]
    unusable: Mapping[str, str] = field(default_factory=dict)
    as_stated: bool = True
    has_names: bool = True
    guesses: tuple[str, ...] = ()
    remarks: list[str] = field(default_factory=list, compare=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the columns."""
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
                values, held = _measured(file, fields)
                check_room(held, str(self.path))
                rows = max(1, BLOCK_BYTES // (NUMBER_BYTES * max(1, values)))
                for batch in file.iter_batches(min(rows, MOST_ROWS), columns=fields):
                    yield [self._values(batch.column(c.field), c) for c in chosen]
        except RecordingError:
            raise
        except Exception as error:  # a damaged file raises anything
            raise _damaged(self.path, error) from error

    def _values(self, array: pa.Array, column: _Column) -> NDArray[Any]:
        for step in column.path:
            array = (
                pc.list_element(array, step)
                if isinstance(step, int)
                else pc.struct_field(array, step)
            )
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
            around = _of_the_file(file.schema_arrow.metadata or {})
            for one in file.schema_arrow:
                own = _text_of(one.metadata or {})
                for name, steps, kind in _leaves(one, file):
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
    return ParquetTable(path, tuple(columns), unusable, as_stated)


def _opened(path: Path) -> pq.ParquetFile:
    """The file, of which text is kept as in it: a word that stands in many rows is there once."""
    with pq.ParquetFile(path) as file:
        flat = [one for one in file.schema if one.path == one.name]
    text = [one.name for one in flat if one.logical_type.type == "STRING"]
    return pq.ParquetFile(path, read_dictionary=text)


def _measured(file: pq.ParquetFile, fields: Sequence[str]) -> tuple[int, int]:
    """Values in a row of some fields, and bytes in which a row group keeps them; at most."""
    values, held = 0, 0
    for k in range(file.num_row_groups):
        group = file.metadata.row_group(k)
        leaves = [group.column(j) for j in range(group.num_columns)]
        ours = [
            c for c in leaves if f"{c.path_in_schema}.".startswith(tuple(f"{f}." for f in fields))
        ]
        values = max(values, sum(c.num_values for c in ours) // max(1, group.num_rows))
        held = max(held, sum(c.total_uncompressed_size for c in ours))
    return values, held


def _leaves(
    one: pa.Field, file: pq.ParquetFile
) -> Iterator[tuple[str, tuple[str | int, ...], pa.DataType]]:
    """Name, way and type of every column in a field."""
    if pa.types.is_struct(one.type):
        for inner in one.type:
            yield f"{one.name}/{inner.name}", (inner.name,), inner.type
    elif _measured(file, [one.name])[0] > MOST_COLUMNS:
        yield one.name, (), one.type
    elif pa.types.is_fixed_size_list(one.type):
        for k in range(one.type.list_size):
            yield f"{one.name}[{k + 1}]", (k,), one.type.value_type
    elif pa.types.is_list(one.type) or pa.types.is_large_list(one.type):
        first = next(file.iter_batches(1, columns=[one.name]), None)
        length = len(first.column(0)[0].as_py() or ()) if first is not None else 0
        for k in range(length):
            yield f"{one.name}[{k + 1}]", (k,), one.type.value_type
    else:
        yield one.name, (), one.type


def _of_the_file(metadata: Mapping[bytes, bytes]) -> Stated:
    own = _text_of({k: v for k, v in metadata.items() if k != PANDAS and b":" not in k})
    with suppress(ValueError, AttributeError, TypeError):  # what is no JSON says nothing
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
