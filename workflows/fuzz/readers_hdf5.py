"""Readers of HDF5, MagScope's files among it: sound ones, and of another structure.

Groups and virtual datasets have the time in them, so that these files differ in it from run to run.
"""

from __future__ import annotations

import gzip
import io
from functools import cache, partial
from typing import Any

import h5py
import numpy as np
from case import Case, Reader
from odd import Random, odd_array, odd_name, odd_value, pick
from tables_read import FIVE, ROWS, five_columns, odd_columns, one_file, setup_of, steps

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
        one_file("r.h5", hdf5(_plain)),
        one_file("r.h5", hdf5(partial(_plain, chunks=(16,), compression="gzip"))),
        one_file("r.h5", hdf5(_described)),
        one_file("r.h5", hdf5(_described)),
        one_file("r.h5", hdf5(_described, version="v110")),
        one_file("r.h5", hdf5(_table), *records),
        one_file("r.h5.gz", gzip.compress(hdf5(_plain), mtime=0)),
        one_file(
            "r.mat", head + hdf5(partial(_plain, chunks=(16,)), version="v110", userblock=512)[512:]
        ),
    ]


def odd_hdf5(random: Random) -> Case:
    """Other datasets and attributes, groups in place of datasets, and huge empty ones."""

    def fill(file: h5py.File) -> None:
        for name, values in odd_columns(random).items():
            plain = name.replace("\0", "0").strip("/.") or "none"
            _put(file, plain, values, random)
        for node in list(file.values()):
            if random.random() < 0.3:
                _describe(node, random)
        _describe(file, random)

    return one_file("r.h5", hdf5(fill, version=pick(random, ("earliest", "v108", "v110"))))


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
        source = pick(random, (".", "other.h5"))
        # a sign of its own in names of virtual sources
        layout[:] = h5py.VirtualSource(source, name.replace("%", "%%"), (ROWS,))
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
        # an odd name may be that of the root
        group = file.require_group(
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
    Reader("hdf5", hdf5_seeds, odd_hdf5, steps),
    Reader("magscope", magscope_seeds, odd_magscope, steps),
)
