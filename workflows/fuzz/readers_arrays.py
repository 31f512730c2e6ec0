"""Readers of files that hold arrays: sound files of every layout, and files of another structure."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from functools import cache, partial
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
from case import Case, Reader
from damage import damaged
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter
from odd import Random, odd_array, odd_name, odd_value, pick
from tables_read import ROWS, five_columns, five_source, setup_of, steps

FIVE = ("Time", "Magnet", "X", "Y", "Z")


def _one(name: str, content: bytes, *names: str | int, **more: Any) -> Case:
    return Case({name: content}, name, setup_of(five_source(*names, **more)))


def _odd_columns(random: Random, *, rare: bool = True) -> dict[str, Any]:
    """Columns as they should be, of which some are odd, gone, or under another name."""
    columns: dict[str, Any] = dict(five_columns())
    for _ in range(int(random.integers(1, 4))):
        name = pick(random, FIVE)
        way = random.integers(4)
        if way == 0:
            columns.pop(name, None)
        elif way == 1:
            columns[odd_name(random)] = odd_array(random, rare=rare)
        else:
            columns[name] = odd_array(random, rare=rare)
    return columns


# ------------------------------------------------------------------ numpy


def npy(array: Any) -> bytes:
    """An array as a `.npy` file."""
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def npz(members: dict[str, bytes], *, packed: bool) -> bytes:
    """An archive of `.npy` files."""
    stream = io.BytesIO()
    kind = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
    with zipfile.ZipFile(stream, "w", kind) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return stream.getvalue()


def npy_header(header: str, data: bytes, version: int = 1) -> bytes:
    """A `.npy` file whose header says this."""
    text = header.encode("latin-1", "replace") + b"\n"
    length = struct.pack("<H" if version == 1 else "<I", len(text) & 0xFFFF)
    return b"\x93NUMPY" + bytes([version, 0]) + length + text + data


@cache
def numpy_seeds() -> list[Case]:
    """Tables by rows and columns, records, and archives, packed and not."""
    columns = five_columns()
    table = np.column_stack(list(columns.values()))
    records = np.zeros(ROWS, [("Time", "f8"), ("Magnet", "f4"), ("p", "f8", (3,))])
    records["Time"], records["p"] = columns["Time"], table[:, 2:]
    members = {name: npy(values) for name, values in columns.items()}
    return [
        _one("r.npy", npy(table), 1, 2, 3, 4, 5),
        _one("r.npy", npy(np.asfortranarray(table.T)), 1, 2, 3, 4, 5),
        _one("r.npy", npy(records), "Time", "Magnet", "p[1]", "p[2]", "p[3]"),
        _one("r.npz", npz(members, packed=False)),
        _one("r.npz", npz(members, packed=True)),
    ]


def odd_numpy(random: Random) -> Case:
    """Other types and shapes, headers that announce too much, and archives with odd members."""
    way = random.integers(4)
    if way == 0:
        return _one("r.npy", npy(odd_array(random)), 1, 2, 3, 4, 5)
    if way == 1:
        shape = pick(
            random,
            ("(60, 5)", "(10**12,)", "(1000000000000, 5)", "(5, 1000000000000)", "(-1, 5)", "()",
             "(0,)", "(2**70,)", "(9223372036854775807, 3)", "(60.0,)", "(True, 5)", "'a'",
             "(99999999999999999999999,)", "(1,)*40", "(60,)", "((60,),)", "(" * 3000),
        )  # fmt: skip
        kind = pick(
            random,
            ("<f8", ">f8", "<i4", "|O", "<U9999999", "|S0", "|V0", "<M8[ns]", "<M8", "q", "é",
             "<f16", "|S2147483647", ("x", "<f8"), [("x", "<f8")], [("x", "O")], [("", "<f8")],
             [("a\nb", "<f8", (10**9,))], [("x", [("y", "<f8")])]),
        )  # fmt: skip
        order = pick(random, (True, False, 1, "x"))
        header = f"{{'descr': {kind!r}, 'fortran_order': {order!r}, 'shape': {shape}, }}"
        content = npy_header(header, bytes(2400), pick(random, (1, 1, 2, 3, 9)))
        if random.random() < 0.3:
            return _one("r.npz", npz({"Time": content}, packed=bool(random.integers(2))))
        return _one("r.npy", content, 1, 2, 3, 4, 5)
    members = {}
    for name, values in _odd_columns(random).items():
        content = npy(values)
        members[name] = damaged(content, random) if random.random() < 0.3 else content
    return _one("r.npz", npz(members, packed=bool(random.integers(2))))


# ------------------------------------------------------------------ MATLAB


def matlab(content: dict[str, Any], *, packed: bool = False, version: str = "5") -> bytes:
    """A MATLAB file."""
    stream = io.BytesIO()
    scipy.io.savemat(stream, content, do_compression=packed, format=version)
    return stream.getvalue()


@cache
def matlab_seeds() -> list[Case]:
    """Arrays, structs, cells, text, complex and sparse ones; versions 4, 5, and 7 (packed)."""
    columns = five_columns()
    upright = {name: values[:, None] for name, values in columns.items()}
    cell = np.empty(5, object)
    cell[:] = list(columns.values())
    mixed = {
        "data": dict(columns),
        "note": "text",
        "c": np.ones((5, 2)) + 1j,
        "s": scipy.sparse.csc_matrix(np.eye(4)),
        "list": np.array([({"x": 1.0},), ({"x": 2.0},)], [("p", object)]),
        "truth": np.array([True, False]),
        "short": np.arange(4, dtype=np.int16),
    }
    inner = tuple(f"data/{name}" for name in FIVE)
    return [
        _one("r.mat", matlab(upright)),
        _one("r.mat", matlab(upright, packed=True)),
        _one("r.mat", matlab(upright, version="4")),
        _one("r.mat", matlab(mixed), *inner),
        _one("r.mat", matlab(mixed, packed=True), *inner),
        _one("r.mat", matlab({"c": cell}), *(f"c[{k}]" for k in range(1, 6))),
    ]


def _odd_matlab_value(random: Random, depth: int = 2) -> Any:
    way = random.integers(8 if depth else 4)
    if way <= 3:
        array = odd_array(random, rare=False)
        return array.astype("f8") if array.dtype == np.float16 else array
    if way == 4:
        return scipy.sparse.csc_matrix(np.eye(int(random.integers(1, 5))))
    if way == 5:
        return pick(random, ("", "text", "a\nb", "ü"))
    if way == 6:
        cell = np.empty(int(random.integers(4)), object)
        for k in range(len(cell)):
            cell[k] = _odd_matlab_value(random, depth - 1)
        return cell
    return {pick(random, ("x", "y", "Time", "a_b")): _odd_matlab_value(random, depth - 1)}


def odd_matlab(random: Random) -> Case:
    """Other variables, and packed elements that are damaged within their packing."""
    version = "4" if random.random() < 0.15 else "5"
    columns: dict[str, Any] = {n: v[:, None] for n, v in five_columns().items()}
    for _ in range(int(random.integers(1, 4))):
        name = pick(random, (*FIVE, "other", "x" * 31, "data"))
        columns[name] = random.normal(size=(4, 3)) if version == "4" else _odd_matlab_value(random)
    content = matlab(columns, version=version)
    if version == "5" and random.random() < 0.5:
        content = content[:128] + b"".join(
            _packed(element, random) for element in _elements(content[128:])
        )
    return _one("r.mat", content)


def _elements(content: bytes) -> list[bytes]:
    parts, at = [], 0
    while at + 8 <= len(content):
        (length,) = struct.unpack_from("<I", content, at + 4)
        parts.append(content[at : at + 8 + length])
        at += 8 + length
    return parts


def _packed(element: bytes, random: Random) -> bytes:
    packed = zlib.compress(damaged(element, random) if random.random() < 0.4 else element)
    return struct.pack("<II", 15, len(packed)) + packed


# ------------------------------------------------------------------ HDF5


def hdf5(fill: Any, *, version: str = "earliest", userblock: int = 0) -> bytes:
    """An HDF5 file that `fill` fills."""
    stream = io.BytesIO()
    with h5py.File(stream, "w", libver=(version, "latest"), userblock_size=userblock) as file:
        fill(file)
    return stream.getvalue()


def _plain(file: h5py.File, **more: Any) -> None:
    for name, values in five_columns().items():
        file.create_dataset(name, data=values, **more)


def _described(file: h5py.File) -> None:
    """Attributes of every kind, text of variable length among them, and links."""
    _plain(file, chunks=(16,), maxshape=(None,))
    file.attrs["program"] = "tracker 1.0"
    file.attrs["frame_rate"] = 100.0
    file["X"].attrs["units"] = "nm"
    file["Y"].attrs.create("unit", np.bytes_("nm"))
    file["Z"].attrs["names"] = ["a", "b", "c"]
    file["Z"].attrs["list"] = np.arange(3)
    file.create_dataset("notes", data=["one", "two", "three"], dtype=h5py.string_dtype())
    file.create_dataset("ragged", (3,), h5py.vlen_dtype("f8"))[0] = [1.0, 2.0]
    group = file.create_group("group")
    group["soft"] = h5py.SoftLink("/X")
    group["round"] = h5py.SoftLink("/group")
    group["other"] = h5py.ExternalLink("other.h5", "/X")
    group["refs"] = np.array([file["X"].ref, file["Y"].ref], h5py.ref_dtype)


def _table(file: h5py.File) -> None:
    columns = five_columns()
    records = np.zeros(ROWS, [(name, "f8") for name in FIVE])
    for name, values in columns.items():
        records[name] = values
    file.create_dataset("d", data=records, compression="gzip", shuffle=True, fletcher32=True)


@cache
def hdf5_seeds() -> list[Case]:
    """Plain, chunked, packed and described files, of old and new versions of the format."""
    records = tuple(f"d/{name}" for name in FIVE)
    head = b"MATLAB 7.3 MAT-file".ljust(512)
    return [
        _one("r.h5", hdf5(_plain)),
        _one("r.h5", hdf5(partial(_plain, chunks=(16,), compression="gzip"))),
        _one("r.h5", hdf5(_described)),
        _one("r.h5", hdf5(_described)),
        _one("r.h5", hdf5(_described, version="v110")),
        _one("r.h5", hdf5(_table), *records),
        _one(
            "r.mat", head + hdf5(partial(_plain, chunks=(16,)), version="v110", userblock=512)[512:]
        ),
    ]


def odd_hdf5(random: Random) -> Case:
    """Other datasets and attributes, groups in place of datasets, and huge empty ones."""

    def fill(file: h5py.File) -> None:
        for name, values in _odd_columns(random).items():
            plain = name.replace("\0", "0").strip("/.") or "none"
            _put(file, plain, values, random)
        for node in list(file.values()):
            if random.random() < 0.3:
                _describe(node, random)
        _describe(file, random)

    return _one("r.h5", hdf5(fill, version=pick(random, ("earliest", "v108", "v110"))))


def _put(file: h5py.File, name: str, values: Any, random: Random) -> None:
    way = random.integers(12)
    if name in file:
        return
    if way == 0:
        file.create_group(name)[pick(random, ("x", "y"))] = np.arange(3.0)
    elif way == 1:
        long = pick(random, (10**6, 10**9, 10**13))
        file.create_dataset(name, (long,), "f8", chunks=(1000,), maxshape=(None,))
    elif way == 2:
        file.create_dataset(name, (10**13,), "f8")
    elif way == 3:
        file.create_dataset(name, data=["a", "b"], dtype=h5py.string_dtype())
    elif way == 4:
        file[name] = h5py.Empty("f8")
    elif way == 5:
        layout = h5py.VirtualLayout((ROWS,), "f8")
        layout[:] = h5py.VirtualSource(pick(random, (".", "other.h5")), name, (ROWS,))
        file.create_virtual_dataset(name, layout)
    else:
        try:
            file.create_dataset(name, data=values)
        except (TypeError, ValueError):  # a type that the format has not
            file[name] = np.arange(3)


def _describe(node: Any, random: Random) -> None:
    for _ in range(int(random.integers(1, 4))):
        name = pick(random, ("units", "scale_factor", "add_offset", "_FillValue", "valid_range",
                             "frame_rate", "dt", "offset", odd_name(random)))  # fmt: skip
        name = name.replace("\0", "0") or "none"
        _state(node, name, odd_value(random, 1) if random.random() < 0.7 else odd_array(random))


def _state(node: Any, name: str, value: Any) -> None:
    try:
        node.attrs[name] = value
    except (TypeError, ValueError, OverflowError, RuntimeError, AttributeError, OSError):
        node.attrs[name] = np.arange(3)  # for what the format has no type


# ------------------------------------------------------------------ TDMS


def tdms(segments: list[list[Any]]) -> bytes:
    """A TDMS file of these segments."""
    stream = io.BytesIO()
    with TdmsWriter(stream) as writer:
        for objects in segments:
            writer.write_segment(objects)
    return stream.getvalue()


def _channels(columns: dict[str, Any], group: str = "data", **properties: Any) -> list[Any]:
    return [
        RootObject({"name": "made up"}),
        GroupObject(group, {"note": "text"}),
        *(ChannelObject(group, n, v, properties) for n, v in columns.items()),
    ]


@cache
def tdms_seeds() -> list[Case]:
    """One and several segments, properties, scaling, and two groups."""
    columns = five_columns()
    halves = [{n: v[:30] for n, v in columns.items()}, {n: v[30:] for n, v in columns.items()}]
    scaled = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear",
              "NI_Scale[0]_Linear_Slope": 1.0, "NI_Scale[0]_Linear_Y_Intercept": 0.0,
              "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF}  # fmt: skip
    stamped = columns | {
        "Time": np.datetime64("2026-01-01") + np.arange(0, 10 * ROWS, 10).astype("m8[ms]")
    }
    texts = {"words": ["a", "b", "c"]}
    grouped = tuple(f"data/{name}" for name in FIVE)
    return [
        _one("r.tdms", tdms([_channels(columns, wf_increment=0.01, program="tracker")])),
        _one("r.tdms", tdms([_channels(half) for half in halves])),
        _one("r.tdms", tdms([_channels(columns, **scaled)])),
        _one("r.tdms", tdms([_channels(columns), _channels(texts, "other")]), *grouped),
        _one("r.tdms", tdms([_channels(stamped)])),
    ]


def odd_tdms(random: Random) -> Case:
    """Other channels, segments, properties and scales."""
    segments = []
    for _ in range(int(random.integers(1, 4))):
        columns = {}
        for name, values in _odd_columns(random, rare=False).items():
            flat = np.ravel(values)
            known = (flat.dtype.kind in "iuf" and flat.dtype.itemsize != 2) or flat.dtype == "i2"
            columns[name] = flat if known and flat.dtype.isnative else np.arange(3.0)
        segments.append(_channels(columns, odd_name(random), **_odd_properties(random)))
    return _one("r.tdms", tdms(segments))


def _odd_properties(random: Random) -> dict[str, Any]:
    names = ("wf_increment", "wf_start_offset", "unit_string", "NI_Number_Of_Scales",
             "NI_Scale[0]_Scale_Type", "NI_Scale[0]_Linear_Slope", "NI_Scaling_Status",
             "NI_Scale[0]_Polynomial_Coefficients_Size", "NI_Scale[0]_Linear_Input_Source",
             odd_name(random))  # fmt: skip
    values = ("Linear", "Polynomial", "RTD", "Table", "scaled", "unscaled", 0, 1, -1, 7, 1e300,
              float("nan"), "a\nb", True, 10**9)  # fmt: skip
    return {pick(random, names): pick(random, values) for _ in range(int(random.integers(4)))}


# ------------------------------------------------------------------ Parquet


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
        _one("r.parquet", parquet(plain, compression="none", use_dictionary=False)),
        _one("r.parquet", parquet(plain, compression="snappy")),
        Case({"r.parquet": parquet(canonical, compression="zstd")}, "r.parquet", setup_of(None)),
        _one("r.parquet", parquet(lists, compression="none", row_group_size=20),
             "Time", "Magnet", "p[1]", "p[2]", "v[3]"),
        _one("r.parquet", parquet(pa.Table.from_pandas(frame), compression="gzip")),
    ]  # fmt: skip


def odd_parquet(random: Random) -> Case:
    """Other types, names and metadata."""
    arrays, names = [], []
    for name, values in _odd_columns(random).items():
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
        )  # fmt: skip
        for n, a in zip(names, arrays, strict=True)
    ]
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=metadata))
    return _one("r.parquet", parquet(table, compression=pick(random, ("none", "snappy", "zstd"))))


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


# ------------------------------------------------------------------ MagScope


def magscope(random: Random | None = None) -> bytes:
    """A tracking file of MagScope, of which something is odd if there is a generator."""
    n, beads = ROWS, (3, 7)
    content: dict[str, Any] = {
        "frame_timestamps_ns": 1_700_000_000 * 10**9 + np.arange(n, dtype="u8") * 10**7,
        "frame_offsets": np.arange(n + 1, dtype="u8") * 2,
        "frame_batch_sequence": np.repeat(np.arange(3, dtype="u8"), n // 3),
        "batch_sequence": np.arange(3, dtype="u8"),
        "bead_ids": np.tile(np.array(beads, "u2"), n),
        "positions_nm": np.random.default_rng(0).normal(1000, 30, (2 * n, 3)),
    }
    attributes: dict[str, Any] = {
        "schema_version": 1, "recording_id": 5, "recording_start_ns": 1_700_000_000 * 10**9,
        "program": "MagScope",
    }  # fmt: skip
    if random is not None:
        _spoil(content, attributes, random)

    def fill(file: h5py.File) -> None:
        group = file.create_group(
            "tracking" if random is None or random.random() < 0.98 else odd_name(random) or "none"
        )
        for name, values in content.items():
            if random is None:
                group.create_dataset(
                    name, data=values, chunks=True, maxshape=(None, 3)[: values.ndim]
                )
            else:
                _put(group, name, values, random)
        for name, value in attributes.items():
            _state(group, name, value)

    return hdf5(fill)


def _spoil(content: dict[str, Any], attributes: dict[str, Any], random: Random) -> None:
    for _ in range(int(random.integers(1, 3))):
        name = pick(random, list(content))
        values = content[name]
        way = random.integers(6) if np.size(values) and np.ndim(values) else 5
        if way == 0:
            content.pop(name)
        elif way == 1:
            content[name] = odd_array(random, rare=False)
        elif way == 2:
            content[name] = values[: int(random.integers(len(values)))]
        elif way == 3 and values.ndim == 1:
            changed = values.copy()
            changed[random.integers(len(values))] = pick(random, (0, 1, 2**15, 2**16 - 1))
            content[name] = changed
        elif way == 4:
            content[name] = random.permutation(values)
        else:
            attributes[pick(random, list(attributes))] = odd_value(random, 1)


@cache
def magscope_seeds() -> list[Case]:
    """A tracking file."""
    setup = setup_of({"preset": "magscope-hdf5", "z_zero": {"value_nm": 0.0}})
    return [Case({"Tracking Data 1.h5": magscope()}, "Tracking Data 1.h5", setup)]


def odd_magscope(random: Random) -> Case:
    """Other datasets and attributes."""
    return magscope_seeds()[0].with_content(magscope(random))


READERS = (
    Reader("numpy", numpy_seeds, odd_numpy, steps),
    Reader("matlab", matlab_seeds, odd_matlab, steps),
    Reader("hdf5", hdf5_seeds, odd_hdf5, steps),
    Reader("tdms", tdms_seeds, odd_tdms, steps),
    Reader("parquet", parquet_seeds, odd_parquet, steps),
    Reader("magscope", magscope_seeds, odd_magscope, steps),
)
