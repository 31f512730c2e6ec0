"""The reader of Parquet files: sound ones, and of another structure."""

from __future__ import annotations

import io
from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from case import Case, Reader
from odd import Random, odd_name, odd_value, pick
from tables_read import ROWS, five_columns, odd_columns, one_file, setup_of, steps


def parquet(table: pa.Table, **options: Any) -> bytes:
    """A Parquet file."""
    stream = io.BytesIO()
    pq.write_table(table, stream, **options)
    return stream.getvalue()


@cache
def parquet_seeds() -> list[Case]:
    """Columns, structs and lists, with and without packing, dictionaries and pandas' metadata."""
    columns = five_columns()
    plain = pa.table(columns)
    canonical = pa.table(
        {"time_s": columns["Time"], "magnet_mm": columns["Magnet"]}
        | {f"b1_{axis.lower()}_nm": columns[axis] for axis in "XYZ"}
    )
    xyz = np.column_stack([columns[axis] for axis in "XYZ"])
    lists = pa.table(
        {
            "Time": columns["Time"],
            "Magnet": pa.array(columns["Magnet"]).dictionary_encode(),
            "p": pa.FixedSizeListArray.from_arrays(pa.array(xyz.ravel()), 3),
            "v": pa.array(xyz.tolist()),
            "s": pa.StructArray.from_arrays([pa.array(columns["X"])], ["x"]),
            "words": ["a"] * ROWS,
        }
    )
    frame = plain.to_pandas()
    frame.attrs["frame_rate"] = 100.0
    return [
        one_file("r.parquet", parquet(plain, compression="none", use_dictionary=False)),
        one_file("r.parquet", parquet(plain, compression="snappy")),
        Case({"r.parquet": parquet(canonical, compression="zstd")}, "r.parquet", setup_of(None)),
        one_file("r.parquet", parquet(lists, compression="none", row_group_size=20),
             "Time", "Magnet", "p[1]", "p[2]", "v[3]"),
        one_file("r.parquet", parquet(pa.Table.from_pandas(frame), compression="gzip")),
    ]  # fmt: skip


def odd_parquet(random: Random) -> Case:
    """Other types, names and metadata."""
    arrays, names = [], []
    for name, values in odd_columns(random).items():
        names.append(name)
        arrays.append(_odd_arrow(values, random))
    metadata = {odd_name(random): str(odd_value(random)) for _ in range(2)} | {
        pick(random, ("pandas", "frame_rate", "mtpipe")): pick(
            random, ("{", "[]", "null", '{"attributes": 3}', '{"attributes": {"units": "nm"}}',
                     '{"attributes": [1]}', "nan", "-1")),
    }  # fmt: skip
    fields = [
        pa.field(
            n,
            a.type,
            metadata={
                pick(random, ("unit", "scale_factor", "missing_value")): str(odd_value(random, 0))
            },
        )
        for n, a in zip(names, arrays, strict=True)
    ]
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=metadata))
    return one_file(
        "r.parquet", parquet(table, compression=pick(random, ("none", "snappy", "zstd")))
    )


def no_utf_8(rows: int) -> pa.Array:
    """Text that is no UTF-8."""
    ends = pa.py_buffer(np.arange(rows + 1, dtype="i4"))
    return pa.Array.from_buffers(pa.string(), rows, [None, ends, pa.py_buffer(b"\xff" * rows)])


def _odd_arrow(values: Any, random: Random) -> pa.Array:
    flat = np.resize(np.ravel(values), ROWS) if np.size(values) else np.zeros(ROWS)
    way = random.integers(10)
    try:
        if way == 0 and random.random() < 0.3:
            return no_utf_8(ROWS)
        if way == 0:
            return pa.array([pick(random, (None, "a", "\n", "2026-01-01T00:00:00")) for _ in flat])
        if way == 1:
            return pa.array([[1.0] * int(random.integers(3)) for _ in flat])
        if way == 2:
            return pa.array([{"x": 1.0, "y": {"z": 1}} for _ in flat])
        if way == 3:
            return pa.nulls(ROWS)
        if way == 4:
            return pa.array(range(ROWS), pa.decimal128(pick(random, (5, 38)), 2))
        if way == 5:
            kinds = (pa.timestamp("s"), pa.timestamp("ns", "UTC"), pa.time64("ns"), pa.date32(),
                     pa.duration("us"), pa.binary(), pa.bool_(), pa.int8())  # fmt: skip
            return pa.nulls(ROWS, pick(random, kinds))
        if way == 6:
            return pa.array(np.arange(ROWS) * 10**15, pa.timestamp("ns"))
        return pa.array(flat)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError, pa.ArrowTypeError, TypeError):
        return pa.nulls(ROWS)


READERS = (Reader("parquet", parquet_seeds, odd_parquet, steps),)
