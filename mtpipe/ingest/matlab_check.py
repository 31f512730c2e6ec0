"""Whether a MATLAB file (version 5) is built as its headers say, before scipy reads it.

scipy follows headers as they stand: an array that is called complex and has no imaginary part ends
the process. Of arrays of real numbers only headers are looked at, packed ones as well; others are
small in recordings, and are followed to their end.

Source: MAT-File Format (MathWorks, R2019b), "Level 5 MAT-File Format".
"""

from __future__ import annotations

import io
import math
import struct
import zlib
from collections.abc import Callable
from functools import partial
from typing import BinaryIO, Literal

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.announced import check_announced, check_room

HEADER_BYTES, ENDIAN_AT = 128, 126
# Types of data elements
INT8, INT32, UINT32, MATRIX, PACKED = 1, 5, 6, 14, 15
NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})
CHARACTERS = NUMBERS | {16, 17, 18}
# Classes of arrays; numeric ones are 6 to 15.
CELL, STRUCT, CHAR, SPARSE = 1, 2, 4, 5
NUMERIC = range(6, 16)
COMPLEX = 0x0800  # among the flags of an array
# Flags, size and name of an array take far less; names are of 63 letters at most.
HEAD_BYTES = 4096


def check_matlab(stream: BinaryIO) -> None:
    """Go through the elements of a file, which is left at its start.

    Raises
    ------
    RecordingError : they do not fit into one another, or unfold to more than the memory.
    """
    unfolded = 0  # bytes: all variables are read
    stream.seek(0)
    order = byte_order(stream.read(HEADER_BYTES))
    size = stream.seek(0, io.SEEK_END)
    at = HEADER_BYTES
    while at < size:
        stream.seek(at)
        kind, length = _tag(stream.read(8), order)
        if kind not in (MATRIX, PACKED) or at + 8 + length > size:
            raise _damaged(f"an element of type {kind} and {length} bytes at byte {at}")
        if kind == PACKED:
            unfolded += _check_packed(stream.read(length), order, unfolded)
        else:
            head = stream.read(min(length, HEAD_BYTES))
            _check_array(head, partial(_go_on, stream, head, length), order, length)
        at += 8 + length
    stream.seek(0)


def byte_order(head: bytes) -> Literal["<", ">"]:
    """Order of the bytes in a file with this header, as scipy takes it."""
    return "<" if head[ENDIAN_AT:HEADER_BYTES] == b"IM" else ">"


def _go_on(stream: BinaryIO, head: bytes, length: int) -> bytes:
    return head + stream.read(length - len(head))


def _check_packed(packed: bytes, order: str, before: int) -> int:
    """Check a packed array, after others that unfold to `before` bytes; its own size unpacked."""
    try:
        head = zlib.decompressobj().decompress(packed, HEAD_BYTES)
        kind, length = _tag(head[:8], order)
        if kind != MATRIX:
            raise _damaged(f"a packed element of type {kind}")
        check_announced(length, len(packed), packed=True, where="")
        check_room(before + length, where="")
        _check_array(head[8:], lambda: zlib.decompress(packed)[8:], order, length)
    except zlib.error as error:
        raise _damaged(str(error)) from None
    return length


def _check_array(head: bytes, whole: Callable[[], bytes], order: str, size: int) -> None:
    """Check one array of `size` bytes by its head, or by all of it where it has several parts."""
    if not head:  # an empty cell
        return
    parts = _Parts(head, order)
    flags_at, flags_length = parts.next({UINT32})
    if flags_length < 4:
        raise _damaged("an array without flags")
    (flags,) = struct.unpack_from(order + "I", head, flags_at)
    kind = flags & 0xFF
    if kind not in (CELL, STRUCT, CHAR, SPARSE, *NUMERIC):  # objects, which are not read as numbers
        return
    sizes_at, sizes_length = parts.next({INT32})
    sizes = struct.unpack_from(f"{order}{sizes_length // 4}i", head, sizes_at)
    parts.next({INT8})
    several = kind not in NUMERIC or bool(flags & COMPLEX)
    parts.content = whole() if several else head
    parts.size = len(parts.content) if several else size
    if kind in (CELL, STRUCT):
        if kind == STRUCT:
            parts.next({INT32})
            parts.next({INT8})
        held = 0
        while not parts.at_end:
            start, length = parts.next({MATRIX})
            inner = parts.content[start : start + length]
            _check_array(inner, partial(bytes, inner), order, length)
            held += 1
        # room for all of them is taken before the first is read
        if math.prod(sizes) > max(held, 1):
            raise _damaged(f"an array of {math.prod(sizes)} cells or structs that holds {held}")
        return
    if kind == SPARSE:
        parts.next({INT32, UINT32})
        parts.next({INT32, UINT32})
    for _ in range(2 if flags & COMPLEX else 1):
        parts.next(CHARACTERS if kind == CHAR else NUMBERS)


class _Parts:
    """The elements within an array, one after the other."""

    def __init__(self, content: bytes, order: str) -> None:
        self.content, self.size = content, len(content)
        self._order, self._at = order, 0

    @property
    def at_end(self) -> bool:
        """Whether no element follows."""
        return self._at >= len(self.content)

    def next(self, kinds: frozenset[int] | set[int]) -> tuple[int, int]:
        """Start and length of the next element, which has to be of one of these types."""
        tag = self.content[self._at : self._at + 8]
        kind, length = _tag(tag, self._order)
        start = self._at + 8
        if kind >> 16:  # a small element: its length and content stand in the tag itself
            kind, length, start = kind & 0xFFFF, kind >> 16, self._at + 4
            following = self._at + 8
        else:
            following = start + length + -length % 8
        if kind not in kinds:
            raise _damaged(f"an element of type {kind} where {sorted(kinds)} may stand")
        if start + length > self.size:
            raise _damaged(f"an element of {length} bytes in an array of {self.size}")
        self._at = following
        return start, length


def _tag(data: bytes, order: str) -> tuple[int, int]:
    """Type and length of an element."""
    if len(data) < 8:
        raise _damaged("an element without a header")
    kind, length = struct.unpack(order + "II", data)
    return kind, length


def _damaged(what: str) -> RecordingError:
    return RecordingError(
        f"is damaged or cut off: it has {what}", mend="Copy the file again, or save it again."
    )
