"""Whether the heaps in which HDF5 keeps text of any length are built as their headers say.

HDF5 goes from object to object by their sizes: one of size zero, or one that wraps around, is
followed for ever, and nothing in Python can stop it. Only HDF5 itself knows where heaps are, so
what it reads is watched: a heap is looked through before HDF5 sees it.

Source: HDF5 file format specification, version 3.0, section III.E (global heaps).
"""

from __future__ import annotations

import io
from typing import Any, BinaryIO

# The mark with version 1 and three bytes of zeros, which numbers of a recording do not look like.
MARK = b"GCOL\x01\x00\x00\x00"
# Bytes of a heap that HDF5 reads before it knows the heap's length (H5HG_MINSIZE).
FIRST_BYTES = 4096
ALIGNED = 8


class WatchedHeaps(io.RawIOBase):
    """A file in which heaps of text whose objects do not fit cannot be read.

    Parameters
    ----------
    width : bytes of a length in this file.

    Attributes
    ----------
    fault : a sentence about a heap that was met and is damaged, or "".
    """

    def __init__(self, stream: BinaryIO, width: int) -> None:
        super().__init__()
        self._stream, self._width = stream, width
        self.fault = ""

    def seekable(self) -> bool:
        """It is."""
        return True

    def readable(self) -> bool:
        """It is."""
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        """Go to a place."""
        return self._stream.seek(offset, whence)

    def readinto(self, buffer: Any, /) -> int:
        """Fill a buffer.

        Raises
        ------
        OSError : it holds the begin of a heap whose objects do not fit into it.
        """
        begin = self._stream.tell()
        got = int(self._stream.readinto(buffer))  # type: ignore[attr-defined]
        if got <= FIRST_BYTES:
            self._check(begin, bytes(memoryview(buffer)[:got]))
            self._stream.seek(begin + got)
        return got

    def _check(self, begin: int, content: bytes) -> None:
        """Check heaps whose mark ends in what was read at a place, or a few bytes after."""
        before = min(begin, len(MARK) - 1)
        self._stream.seek(begin - before)
        content = self._stream.read(before) + content
        self._stream.seek(len(content) - before, io.SEEK_CUR)
        content += self._stream.read(len(MARK) - 1)
        at = content.find(MARK)
        while at >= 0:
            self._check_heap(begin - before + at)
            at = content.find(MARK, at + 1)

    def _check_heap(self, at: int) -> None:
        self._stream.seek(at + len(MARK))
        size = int.from_bytes(self._stream.read(self._width), "little")
        self._stream.seek(at)
        if not _is_sound(self._stream.read(size), size, self._width):
            self.fault = f"the heap of text at byte {at} is not as long as its objects"
            raise OSError(self.fault)


def _is_sound(heap: bytes, size: int, width: int) -> bool:
    """Whether objects follow one another up to the end of a heap."""
    head = _aligned(len(MARK) + width)  # of the heap, and of every object as well
    if len(heap) < size or size < head:
        return False
    at = head
    while at + head <= size:
        number = int.from_bytes(heap[at : at + 2], "little")
        length = int.from_bytes(heap[at + 8 : at + 8 + width], "little")
        # object 0 is the space that is left, whose size counts its head
        taken = length if number == 0 else head + _aligned(length)
        if not 0 < taken <= size - at:
            return False
        at += taken
    return True


def _aligned(length: int) -> int:
    return length + -length % ALIGNED
