"""Readers of numpy's, MATLAB's and LabVIEW's files: sound ones, and of another structure."""

from __future__ import annotations

import gzip
import io
import struct
import zipfile
import zlib
from functools import cache
from typing import Any

import numpy as np
import scipy.io
from case import Case, Reader
from damage import damaged
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter
from odd import Random, odd_array, odd_name, pick
from tables_read import FIVE, ROWS, five_columns, odd_columns, one_file, steps

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
            member = zipfile.ZipInfo(f"{name}.npy")  # without the time
            archive.writestr(member, content, kind)
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
        one_file("r.npy", npy(table), 1, 2, 3, 4, 5),
        one_file("r.npy", npy(np.asfortranarray(table.T)), 1, 2, 3, 4, 5),
        one_file("r.npy", npy(records), "Time", "Magnet", "p[1]", "p[2]", "p[3]"),
        one_file("r.npz", npz(members, packed=False)),
        one_file("r.npz", npz(members, packed=True)),
        one_file("r.npy.gz", gzip.compress(npy(table), mtime=0), 1, 2, 3, 4, 5),
    ]


def odd_numpy(random: Random) -> Case:
    """Other types and shapes, headers that announce too much, and archives with odd members."""
    way = random.integers(4)
    if way == 0:
        return one_file("r.npy", npy(odd_array(random)), 1, 2, 3, 4, 5)
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
            return one_file("r.npz", npz({"Time": content}, packed=bool(random.integers(2))))
        return one_file("r.npy", content, 1, 2, 3, 4, 5)
    members = {}
    for name, values in odd_columns(random).items():
        content = npy(values)
        members[name] = damaged(content, random) if random.random() < 0.3 else content
    return one_file("r.npz", npz(members, packed=bool(random.integers(2))))


# ------------------------------------------------------------------ MATLAB


def matlab(content: dict[str, Any], *, packed: bool = False, version: str = "5") -> bytes:
    """A MATLAB file."""
    stream = io.BytesIO()
    scipy.io.savemat(stream, content, do_compression=packed, format=version)
    data = stream.getvalue()
    return data if version == "4" else b"MATLAB 5.0 MAT-file".ljust(116) + data[116:]


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
        one_file("r.mat", matlab(upright)),
        one_file("r.mat", matlab(upright, packed=True)),
        one_file("r.mat", matlab(upright, version="4")),
        one_file("r.mat", matlab(mixed), *inner),
        one_file("r.mat", matlab(mixed, packed=True), *inner),
        one_file("r.mat", matlab({"c": cell}), *(f"c[{k}]" for k in range(1, 6))),
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
    return one_file("r.mat", content)


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
        one_file("r.tdms", tdms([_channels(columns, wf_increment=0.01, program="tracker")])),
        one_file("r.tdms", tdms([_channels(half) for half in halves])),
        one_file("r.tdms", tdms([_channels(columns, **scaled)])),
        one_file("r.tdms", tdms([_channels(columns), _channels(texts, "other")]), *grouped),
        one_file("r.tdms", tdms([_channels(stamped)])),
    ]


def odd_tdms(random: Random) -> Case:
    """Other channels, segments, properties and scales."""
    segments = []
    for _ in range(int(random.integers(1, 4))):
        columns = {}
        for name, values in odd_columns(random, rare=False).items():
            flat = np.ravel(values)
            known = (flat.dtype.kind in "iuf" and flat.dtype.itemsize != 2) or flat.dtype == "i2"
            columns[name] = flat if known and flat.dtype.isnative else np.arange(3.0)
        segments.append(_channels(columns, odd_name(random), **_odd_properties(random)))
    return one_file("r.tdms", tdms(segments))


def _odd_properties(random: Random) -> dict[str, Any]:
    names = ("wf_increment", "wf_start_offset", "unit_string", "NI_Number_Of_Scales",
             "NI_Scale[0]_Scale_Type", "NI_Scale[0]_Linear_Slope", "NI_Scaling_Status",
             "NI_Scale[0]_Polynomial_Coefficients_Size", "NI_Scale[0]_Linear_Input_Source",
             odd_name(random))  # fmt: skip
    values = ("Linear", "Polynomial", "RTD", "Table", "scaled", "unscaled", 0, 1, -1, 7, 1e300,
              float("nan"), "a\nb", True, 10**9)  # fmt: skip
    return {pick(random, names): pick(random, values) for _ in range(int(random.integers(4)))}


# ------------------------------------------------------------------ netCDF 3


def netcdf(columns: dict[str, Any], *, record: bool = False, version: int = 1) -> bytes:
    """A netCDF file of variables, whose rows are records or not, with attributes."""
    stream = io.BytesIO()
    stream.close, close = lambda: None, stream.close  # type: ignore[method-assign]
    with scipy.io.netcdf_file(stream, "w", version=version) as file:
        file.frame_rate = 100.0
        for k, (name, values) in enumerate(columns.items()):
            sides = [f"d{k}{j}" for j in range(np.ndim(values))]
            for side, size in zip(sides, np.shape(values), strict=True):
                if record and side.endswith("0"):
                    sides[0] = "row"
                    if "row" not in file.dimensions:
                        file.createDimension("row", None)
                else:
                    file.createDimension(side, size)
            one = file.createVariable(name, values.dtype, sides)
            one[:] = values
            one.units = {"Time": "s", "Magnet": "mm"}.get(name, "nm")
    content = stream.getvalue()
    close()
    return content


@cache
def netcdf_seeds() -> list[Case]:
    """Variables with and without records, of both versions."""
    return [
        one_file("r.nc", netcdf(five_columns(), record=record, version=version))
        for record in (False, True)
        for version in (1, 2)
    ]


def odd_netcdf(random: Random) -> Case:
    """Other types and shapes."""
    columns = {k.replace("\0", "0"): v for k, v in odd_columns(random).items()}
    try:
        content = netcdf(columns, record=bool(random.integers(2)))
    except Exception:  # what the format has not
        content = damaged(netcdf_seeds()[0].files["r.nc"], random)
    return one_file("r.nc", content)


READERS = (
    Reader("numpy", numpy_seeds, odd_numpy, steps),
    Reader("matlab", matlab_seeds, odd_matlab, steps),
    Reader("netcdf", netcdf_seeds, odd_netcdf, steps),
    Reader("tdms", tdms_seeds, odd_tdms, steps),
)
