"""Damage to the bytes of a sound file: what transfers, discs and programs that stop do to them."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

Random = np.random.Generator
HOW_MANY = (1, 1, 1, 2, 3, 4)
# Inputs stay small, so that thousands can be read.
MOST_BYTES = 1 << 20
# Headers within HDF5 (heaps, trees, objects), zip, TDMS and numpy's files.
MARKS = re.compile(rb"GCOL|HEAP|TREE|SNOD|FRHP|FHDB|OHDR|BTHD|BTLF|FSHD|FAHD|EAHD|PK|TDSm|NUMPY|IM")
TELLING = (0, 1, 8, 9, 10, 13, 32, 34, 44, 46, 47, 127, 128, 254, 255)


def damaged(content: bytes, random: Random) -> bytes:
    """The content with one to four changes."""
    data = bytearray(content)
    for _ in range(HOW_MANY[random.integers(len(HOW_MANY))]):
        if not data:
            return bytes(random.integers(0, 256, 4, dtype=np.uint8))
        change = CHANGES[random.integers(len(CHANGES))]
        data = change(data, random)[:MOST_BYTES]
    return bytes(data)


def place(data: bytearray, random: Random) -> int:
    """A place in the data, often near its beginning or end, or a mark of a header within it."""
    where = random.random()
    if where < 0.35:
        return int(random.integers(len(data)))
    if where < 0.5:
        marks = [match.start() for match in MARKS.finditer(data)]
        if marks:
            near = marks[random.integers(len(marks))] + int(random.integers(48))
            return min(near, len(data) - 1)
    near = int(len(data) ** random.random())
    return min(near, len(data) - 1) if where < 0.8 else max(0, len(data) - near)


def span(data: bytearray, random: Random) -> slice:
    """A piece, mostly short."""
    start = place(data, random)
    return slice(start, start + int(max(2, len(data)) ** random.random()))


def _flip(data: bytearray, random: Random) -> bytearray:
    data[place(data, random) - 1] ^= 1 << int(random.integers(8))
    return data


def _set(data: bytearray, random: Random) -> bytearray:
    data[place(data, random) - 1] = TELLING[random.integers(len(TELLING))]
    return data


def _cut_end(data: bytearray, random: Random) -> bytearray:
    return data[: place(data, random)]


def _cut_out(data: bytearray, random: Random) -> bytearray:
    del data[span(data, random)]
    return data


def _zeros(data: bytearray, random: Random) -> bytearray:
    piece = span(data, random)
    data[piece] = bytes(len(data[piece]))
    return data


def _ones(data: bytearray, random: Random) -> bytearray:
    piece = span(data, random)
    data[piece] = b"\xff" * len(data[piece])
    return data


def _noise(data: bytearray, random: Random) -> bytearray:
    piece = span(data, random)
    data[piece] = random.bytes(len(data[piece]))
    return data


def _repeat(data: bytearray, random: Random) -> bytearray:
    piece = span(data, random)
    again = bytes(data[piece]) * int(random.integers(1, 4))
    data[piece.stop : piece.stop] = again
    return data


def _swap(data: bytearray, random: Random) -> bytearray:
    one, other = span(data, random), span(data, random)
    data[one], data[other] = data[other], data[one]
    return data


def _insert(data: bytearray, random: Random) -> bytearray:
    at = place(data, random)
    data[at:at] = random.bytes(int(random.integers(1, 20)))
    return data


def _length(data: bytearray, random: Random) -> bytearray:
    """Another number where one may stand: of 1, 2, 4 or 8 bytes, in either order of bytes."""
    width = int(random.choice([1, 2, 4, 8]))
    order = "little" if random.random() < 0.7 else "big"
    at = place(data, random)
    if random.random() < 0.7:
        at -= at % width
    old = int.from_bytes(data[at : at + width], order)
    top = 1 << 8 * width
    other = (
        0,
        1,
        top - 1,
        top - 2,
        top >> 1,
        (top >> 1) - 1,
        old + 1,
        old - 1,
        old * 2,
        old << 8,
        old >> 1,
        len(data),
        len(data) - 1,
        1 << 20,
        1 << 31,
        int(random.integers(1 << 62)),
    )
    value = other[random.integers(len(other))] % top
    data[at : at + width] = value.to_bytes(width, order)
    return data


def _twice(data: bytearray, random: Random) -> bytearray:
    return data + data


CHANGES: tuple[Callable[[bytearray, Random], bytearray], ...] = (
    _flip, _flip, _flip, _set, _set, _cut_end, _cut_out, _zeros, _ones, _noise, _repeat, _swap,
    _insert, _length, _length, _length, _length, _twice,
)  # fmt: skip
