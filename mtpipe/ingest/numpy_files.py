"""numpy's own files: one array (`.npy`) or an archive of them (`.npz`)."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache, partial
from typing import IO, Any, BinaryIO

import numpy as np

from mtpipe.ingest.announced import check_announced
from mtpipe.ingest.bounded import check_archive
from mtpipe.ingest.contents import Contents

# What the only array of a `.npy` file is called; records have the names of their fields.
ONLY_ARRAY = "array"
OBJECTS = "Python objects, which are not read"


def open_npy(stream: BinaryIO) -> Contents:
    """List the columns of a `.npy` file, as long as what is there of them."""
    contents = Contents()
    shape, columns_first, dtype = _header(stream)
    if dtype.hasobject:
        contents.unusable[ONLY_ARRAY] = OBJECTS
        return contents
    begin = stream.tell()
    there = (stream.seek(0, io.SEEK_END) - begin) // max(1, dtype.itemsize)
    wanted = math.prod(shape)
    if there < wanted:
        contents.cut = f"is cut off: {there} of {wanted} values are there"
    slow = len(shape) - 1 if columns_first else 0  # the side along which the file grows
    row = max(1, wanted // max(1, shape[slow] if shape else 1))
    rows = min(there, wanted) // row
    shape = (*shape[:slow], rows, *shape[slow + 1 :]) if shape else shape
    stream.seek(begin)
    flat = _values(stream, dtype, math.prod(shape), begin)
    array = flat.reshape(shape, order="F" if columns_first else "C")
    contents.add("" if dtype.names else ONLY_ARRAY, array.shape, dtype, array.__getitem__)
    return contents


def open_npz(stream: BinaryIO, stack: ExitStack) -> Contents:
    """List the columns of a `.npz` archive."""
    archive = stack.enter_context(np.load(stream, allow_pickle=False))
    check_archive(archive.zip, stream.seek(0, io.SEEK_END))
    contents = Contents()
    for member in archive.zip.namelist():
        with archive.zip.open(member) as piece:
            shape, _, dtype = _header(piece)
        name = member.removesuffix(".npy")
        size = archive.zip.getinfo(member).file_size
        check_announced(math.prod(shape) * dtype.itemsize, size, packed=False, where=name)
        if dtype.hasobject:
            contents.unusable[name] = OBJECTS
            continue
        whole = cache(partial(archive.__getitem__, name))
        contents.add(name, shape, dtype, partial(_indexed, whole))
    return contents


def _header(piece: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(piece)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(piece)
    return np.lib.format.read_array_header_2_0(piece)


def _values(stream: BinaryIO, dtype: np.dtype[Any], count: int, begin: int) -> np.ndarray:
    if isinstance(stream, io.BytesIO):
        return np.frombuffer(stream.getbuffer(), dtype, count, begin)
    return np.memmap(stream, dtype, "r", begin, (count,)) if count else np.empty(0, dtype)


def _indexed(whole: Callable[[], Any], index: Any) -> Any:
    return whole()[index]
