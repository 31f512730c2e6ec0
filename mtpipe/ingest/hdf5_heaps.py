"""Whether the heaps in which HDF5 keeps text of any length are built as their headers say.

HDF5 goes from object to object by their sizes: one of size zero, or one that wraps around, is
followed for ever, and nothing in Python can stop it. Heaps are found by their mark, wherever they
stand, as only HDF5 itself knows what points to them.

Source: HDF5 file format specification, version 3.0, section III.E (global heaps).
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import BinaryIO

from mtpipe.errors import RecordingError

# The mark with version 1 and three bytes of zeros, which numbers of a recording do not look like.
MARK = b"GCOL\x01\x00\x00\x00"
BLOCK_BYTES = 1 << 22
ALIGNED = 8


def check_heaps(stream: BinaryIO, width: int) -> None:
    """Go through the objects of all global heaps of a file, which is left at its start.

    Parameters
    ----------
    width : bytes of a length in this file.

    Raises
    ------
    RecordingError : the objects of one do not fit into it.
    """
    for at in list(_heaps(stream)):
        stream.seek(at + len(MARK))
        size = int.from_bytes(stream.read(width), "little")
        stream.seek(at)
        if not _is_sound(stream.read(size), size, width):
            raise RecordingError(
                f"is damaged: the heap of text at byte {at} is not as long as its objects",
                mend="Copy the file again.",
            )
    stream.seek(0)


def _heaps(stream: BinaryIO) -> Iterator[int]:
    """Where the mark stands in the file."""
    stream.seek(0)
    begin, kept = 0, b""
    while block := stream.read(BLOCK_BYTES):
        block = kept + block
        at = block.find(MARK)
        while at >= 0:
            yield begin + at
            at = block.find(MARK, at + 1)
        kept = block[-(len(MARK) - 1) :]
        begin += len(block) - len(kept)


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
