"""HDF5 files, MATLAB v7.3 and netCDF 4 among them.

Links are followed within the file; what lies in another file is named and not read, as a
recording's checksum would not know of it. A file that is cut off is opened with zeros in place of
what is missing, and only rows that lie whole before the cut are taken from it.
"""

from __future__ import annotations

import io
import math
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any, BinaryIO

import h5py
import numpy as np

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.announced import check_announced, check_room
from mtpipe.ingest.column_attributes import NOTHING, Stated, stated_by
from mtpipe.ingest.contents import Contents, as_text
from mtpipe.ingest.hdf5_heaps import WatchedHeaps

# Chunks are kept unpacked up to this size, so that the next block of rows finds them.
CACHE_BYTES = 1 << 26
# Where a superblock of this version states base address, one other address, and the file's end.
ADDRESSES_AT = {0: 24, 1: 28, 2: 12, 3: 12}
HEAD_BYTES = 128
# Where MATLAB 7.3 keeps what cells and objects refer to.
MATLAB_INNER = {"#refs#", "#subsystem#"}
# Marks tables, strings and times of MATLAB's own, whose numbers say nothing outside it.
MATLAB_OBJECT = "MATLAB_object_decode"
MOST_CELLS = 10_000
# Characters that are read of a text in MATLAB's files.
MOST_SIGNS = 1000
# Virtual datasets nested deeper than this count as views of themselves.
MOST_VIEWS = 8
SIGNATURE = b"\x89HDF\r\n\x1a\n"


def open_hdf5(stream: BinaryIO, stack: ExitStack, *, take: bool) -> Contents:
    """List the columns of an HDF5 file.

    Parameters
    ----------
    take : whether a file that is cut off is read as far as it goes.

    Returns
    -------
    Contents, without columns where the file is cut off and not taken.

    Raises
    ------
    RecordingError : text in it is damaged.
    """
    contents = Contents(cut=cut_off(stream))
    size, stated = stream.seek(0, io.SEEK_END), _stated_size(stream)
    if contents.cut:
        if not take:
            return contents
        stream.seek(0)
        stream = _Padded(stream.read(), stated)
    watched = watched_heaps(stream)
    file = stack.enter_context(h5py.File(watched, "r", rdcc_nbytes=CACHE_BYTES))
    _walk(file, "", NOTHING, contents, set(), size if size < stated else None)
    if watched.fault and not contents.cut:
        raise RecordingError(f"is damaged: {watched.fault}", mend="Copy the file again.")
    return contents


def cut_off(stream: BinaryIO) -> str:
    """A sentence about a file that is shorter than it says, "" about one that is whole."""
    size, stated = stream.seek(0, io.SEEK_END), _stated_size(stream)
    stream.seek(0)
    return f"is cut off: {size} of {stated} bytes are there" if size < stated else ""


class _Padded(io.BytesIO):
    """Bytes followed by zeros up to a size, which h5py asks for by seeking to the end."""

    def __init__(self, content: bytes, size: int) -> None:
        super().__init__(content)
        self.whole = size

    def seek(self, offset: int, whence: int = 0) -> int:
        if whence == io.SEEK_END:
            return super().seek(self.whole + offset)
        return super().seek(offset, whence)

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer)
        got = super().readinto(view)
        rest = min(len(view) - got, max(0, self.whole - self.tell()))
        view[got : got + rest] = bytes(rest)
        super().seek(self.tell() + rest)
        return got + rest


def _stated_size(stream: BinaryIO) -> int:
    """The size that the file says it has, 0 where it does not say."""
    head = _superblock(stream)
    if not head:
        return 0
    version = head[8]
    width = head[13] if version < 2 else head[9]
    at = ADDRESSES_AT[version] + 2 * width
    end = int.from_bytes(head[at : at + width], "little")
    return end if end < (1 << 8 * width) - 1 else 0


def watched_heaps(stream: BinaryIO) -> WatchedHeaps:
    """The file at its start, so that HDF5 is not led round and round in it by damaged text."""
    head = _superblock(stream)
    stream.seek(0)
    return WatchedHeaps(stream, (head[14] if head[8] < 2 else head[10]) if head else 8)


def _superblock(stream: BinaryIO) -> bytes:
    """The head of the file, empty where there is none of a known version.

    HDF5 file format specification, version 3.0, section II.A; before the superblock a user's block
    may stand, as MATLAB's does.
    """
    for start in (0, 512, 1024, 2048):
        stream.seek(start)
        head = stream.read(HEAD_BYTES)
        if head.startswith(SIGNATURE):
            return head if len(head) > 14 and head[8] in ADDRESSES_AT else b""
    return b""


def _walk(
    group: h5py.Group,
    path: str,
    around: Stated,
    contents: Contents,
    above: set[int],
    cut_at: int | None,
) -> None:
    """Add all that a group holds; `above` are the groups that it is in, as links may go round."""
    attributes = _attributes(group)
    around = stated_by(attributes, where=path or "the file").within(around)
    if path:  # one without columns describes the group that it is in
        contents.singles |= {f"{path}/{name}": value for name, value in attributes.items()}
    above = above | {_address(group)}
    for key in group:
        if not path and key in MATLAB_INNER:
            continue
        told = key if isinstance(key, str) else key.decode("utf-8", "replace")
        name = f"{path}/{told}" if path else told
        try:
            link = group.get(key, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                contents.unusable[name] = f"a link into another file, {link.filename}"
                continue
            node = group[key]
        except (KeyError, OSError, RuntimeError, ValueError):
            contents.unusable[name] = "a link to nothing" if cut_at is None else "not whole"
            continue
        if isinstance(node, h5py.Group):
            if _address(node) not in above:
                _walk(node, name, around, contents, above, cut_at)
        elif isinstance(node, h5py.Dataset):
            _add(node, name, around, contents, cut_at)
        else:
            contents.unusable[name] = "a type of data"


def _add(
    node: h5py.Dataset, name: str, around: Stated, contents: Contents, cut_at: int | None
) -> None:
    elsewhere = _elsewhere(node)
    if elsewhere:
        contents.unusable[name] = f"kept in another file, {elsewhere}"
    elif _is_endless(node):
        contents.unusable[name] = "a view of itself"
    elif MATLAB_OBJECT in node.attrs:
        kind = _attributes(node).get("MATLAB_class", b"object")
        contents.unusable[name] = f"an object of MATLAB's own ({as_text(kind)[0]})"
    elif node.shape is None:
        contents.unusable[name] = "empty"
    elif _attributes(node).get("MATLAB_class") == b"char" and node.size == max(node.shape):
        contents.add_text(name, "".join(map(chr, np.ravel(_held(node, ()))[:MOST_SIGNS])))
    elif h5py.check_ref_dtype(node.dtype) is h5py.Reference and node.size <= MOST_CELLS:
        _add_cells(node, name, around, contents, cut_at)
    else:
        contents.add(
            name,
            node.shape,
            node.dtype,
            partial(_held, node),
            _attributes(node) | _unwritten(node),
            around=around,
            chunk=node.chunks,
            whole_rows=None if cut_at is None else _whole_rows(node, cut_at),
        )


def _held(node: h5py.Dataset, index: Any) -> Any:
    """Part of a dataset, whose numbers are in the file as its header says."""
    if not node.is_virtual:
        announced = node.size * node.dtype.itemsize
        check_announced(announced, node.id.get_storage_size(), node.chunks is not None, node.name)
        check_room(math.prod(node.chunks or ()) * node.dtype.itemsize, node.name)
    return node[index]


def _add_cells(
    node: h5py.Dataset, name: str, around: Stated, contents: Contents, cut_at: int | None
) -> None:
    """Add what references point to: MATLAB's cells `c[k]`, or fields of structs `s[k]/field`."""
    parent, _, field = name.rpartition("/")
    structs = parent and _attributes(node.parent).get("MATLAB_class") == b"struct"
    for k, reference in enumerate(np.ravel(node[()]).tolist(), start=1):
        label = f"{parent}[{k}]/{field}" if structs else f"{name}[{k}]"
        target = node.file[reference] if reference else None
        if isinstance(target, h5py.Dataset) and h5py.check_ref_dtype(target.dtype) is None:
            _add(target, label, around, contents, cut_at)
        elif isinstance(target, h5py.Group):
            _walk(target, label, around, contents, set(), cut_at)
        else:
            contents.unusable[label] = "a link to nothing, or cells within cells"


def _elsewhere(node: h5py.Dataset) -> str:
    """The other file in which a dataset is kept, if it is."""
    if node.external:
        return str(node.external[0][0])
    others = [s.file_name for s in node.virtual_sources()] if node.is_virtual else []
    return next((other for other in others if other != "."), "")


def _is_endless(node: h5py.Dataset, depth: int = 0) -> bool:
    """Whether a virtual dataset is one of virtual ones without end, which HDF5 would follow."""
    if depth > MOST_VIEWS or not node.is_virtual:
        return bool(node.is_virtual)
    # HDF5 writes a percent sign of a name as two
    names = [s.dset_name.replace("%%", "%") for s in node.virtual_sources() if s.file_name == "."]
    within = [node.file.get(name) for name in names]
    return any(_is_endless(one, depth + 1) for one in within if isinstance(one, h5py.Dataset))


def _address(group: h5py.Group) -> int:
    return int(h5py.h5o.get_info(group.id).addr)


def _attributes(node: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    attributes: dict[str, Any] = {}
    for name in node.attrs:
        with suppress(OSError, TypeError, ValueError, RuntimeError):  # types that h5py has not
            value = node.attrs[name]
            if not isinstance(value, h5py.Empty):
                attributes[name] = value
    return attributes


def _unwritten(node: h5py.Dataset) -> dict[str, Any]:
    """What cells hold that were never written, if the program that made the file chose a value."""
    plan = node.id.get_create_plist()
    chosen = plan.fill_value_defined() == h5py.h5d.FILL_VALUE_USER_DEFINED
    if chosen and node.dtype.kind in "iuf" and node.fillvalue:
        return {"fillvalue": node.fillvalue}
    return {}


def _whole_rows(node: h5py.Dataset, cut_at: int) -> int:
    """How many rows, along the longest side, lie before a place in the file."""
    side = int(np.argmax(node.shape)) if node.shape else 0
    if node.chunks is None:
        offset = node.id.get_offset()
        if offset is None or not node.shape:
            return 0
        row_bytes = node.dtype.itemsize * int(np.prod(node.shape[side + 1 :]))
        if any(n > 1 for n in node.shape[:side]):
            return node.shape[side] if offset + node.nbytes <= cut_at else 0
        return int(np.clip((cut_at - offset) // max(1, row_bytes), 0, node.shape[side]))
    first_bad = node.shape[side]
    written = 0
    for k in range(node.id.get_num_chunks()):
        chunk = node.id.get_chunk_info(k)
        written = max(written, chunk.chunk_offset[side] + node.chunks[side])
        if chunk.byte_offset + chunk.size > cut_at:
            first_bad = min(first_bad, chunk.chunk_offset[side])
    return int(min(first_bad, written))
