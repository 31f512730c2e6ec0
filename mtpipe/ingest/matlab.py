"""MATLAB files of versions 4 to 7: arrays, structs, arrays of structs, and cells.

A field is `struct/field`, that of the k-th struct of an array `struct[k]/field`, the k-th cell
`cell[k]`. Tables, strings and times of MATLAB's are objects of its own, which no other program
reads; they are named.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any, BinaryIO, cast

import numpy as np
import scipy.io
from scipy.io.matlab import MatlabFunction, MatlabOpaque

from mtpipe.ingest.contents import Contents
from mtpipe.ingest.matlab_check import HEADER_BYTES, byte_order, check_matlab

MOST_CELLS = 10_000
VERSION_4_BYTES = 20
COMPRESSED = 15
ITEM_BYTES = (8, 4, 4, 2, 2, 1)


def open_matlab(stream: BinaryIO, *, take: bool) -> Contents:
    """List the columns of a MATLAB file.

    Parameters
    ----------
    take : whether of a file that is cut off the variables are read that are whole.

    Returns
    -------
    Contents, without columns where the file is cut off and not taken.

    Raises
    ------
    RecordingError : a file of version 5 is not built as its headers say.
    """
    contents = Contents()
    whole = _whole_bytes(stream)
    size = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    if whole < size:
        contents.cut = f"is cut off within a variable, at {size} bytes, of which {whole} are whole"
        if not take:
            return contents
        stream = io.BytesIO(stream.read(whole))
    stream.seek(0)
    if _is_version_5(stream.read(HEADER_BYTES)):
        check_matlab(stream)
    stream.seek(0)
    content: dict[str, Any] = scipy.io.loadmat(cast(Any, stream), chars_as_strings=False)
    for name, value in content.items():
        if name is None or name.startswith("__"):
            continue
        _add(contents, name, value)
    if None in content or "__function_workspace__" in content:
        contents.unusable.setdefault("(an object)", "a table, string or time of MATLAB's own")
    return contents


def _is_version_5(head: bytes) -> bool:
    """Whether a file is of version 5, 6 or 7: those of version 4 begin with a small integer."""
    return 0 not in head[:4]


def _whole_bytes(stream: BinaryIO) -> int:
    """Size of the file as far as its variables are whole.

    Each begins with its size (MathWorks, MAT-File Format, 2022, sections 1 and 2).
    """
    size = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    head = stream.read(HEADER_BYTES)
    version_5, order = _is_version_5(head), byte_order(head)
    at = HEADER_BYTES if version_5 else 0
    while at < size:
        stream.seek(at)
        if version_5:
            tag = np.frombuffer(stream.read(8).ljust(8, b"\0"), f"{order}u4")
            end = at + 8 + int(tag[1]) + (-int(tag[1]) % 8 if tag[0] != COMPRESSED else 0)
        else:
            end = at + _bytes_of_version_4(stream.read(VERSION_4_BYTES), size)
        if not at < end <= size:
            return at
        at = end
    return size


def _bytes_of_version_4(head: bytes, size: int) -> int:
    """Size of a variable of version 4 with its head; more than the file's if its head is cut."""
    if len(head) < VERSION_4_BYTES:
        return size + 1
    order = "<" if int.from_bytes(head[:4], "little") < 5000 else ">"
    kind, rows, columns, imaginary, name = np.frombuffer(head, f"{order}i4").tolist()
    item = ITEM_BYTES[kind // 10 % 10 % len(ITEM_BYTES)]
    return VERSION_4_BYTES + int(name + rows * columns * item * (2 if imaginary else 1))


def _add(contents: Contents, name: str, value: Any) -> None:
    if isinstance(value, (MatlabOpaque, MatlabFunction)):
        contents.unusable[name] = "an object of MATLAB's own (a table, string, time or function)"
    elif not isinstance(value, np.ndarray):
        contents.unusable[name] = type(value).__name__
    elif value.dtype.names is not None:
        for label, one in _members(name, value, value.size > 1):
            for key in value.dtype.names:
                _add(contents, f"{label}/{key}", one[key])
    elif value.dtype == object:
        for label, one in _members(name, value, True):
            _add(contents, label, one)
    elif value.dtype.kind == "U" and value.size == value.shape[-1]:  # one line of signs
        contents.add_text(name, "".join(np.ravel(value).tolist()))
    else:
        contents.add(name, value.shape, value.dtype, value.__getitem__)


def _members(name: str, value: np.ndarray, numbered: bool) -> Iterator[tuple[str, Any]]:
    """Structs or cells of an array with their names."""
    long = [n for n in value.shape if n > 1]
    for index in list(np.ndindex(*value.shape))[:MOST_CELLS]:
        places = [i + 1 for i, n in zip(index, value.shape, strict=True) if n > 1 or not long]
        number = ",".join(map(str, places if long else places[:1]))
        yield (f"{name}[{number}]" if numbered else name), value[index]
