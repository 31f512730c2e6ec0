"""MATLAB files of versions 4 to 7: arrays, structs, arrays of structs, and cells.

A field is `struct/field`, that of the k-th struct of an array `struct[k]/field`, the k-th cell
`cell[k]`. Tables, strings and times of MATLAB's are objects of its own, which no other program
reads; they are named.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, BinaryIO, cast

import numpy as np
import scipy.io
from scipy.io.matlab import MatlabFunction, MatlabOpaque

from mtpipe.ingest.contents import Contents

MOST_CELLS = 10_000


def open_matlab(stream: BinaryIO) -> Contents:
    """List the columns of a MATLAB file."""
    content: dict[str, Any] = scipy.io.loadmat(cast(Any, stream), chars_as_strings=False)
    contents = Contents()
    for name, value in content.items():
        if name is None or name.startswith("__"):
            continue
        _add(contents, name, value)
    if None in content or "__function_workspace__" in content:
        contents.unusable.setdefault("(an object)", "a table, string or time of MATLAB's own")
    return contents


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
    else:
        contents.add(name, value.shape, value.dtype, value.__getitem__)


def _members(name: str, value: np.ndarray, numbered: bool) -> Iterator[tuple[str, Any]]:
    """Structs or cells of an array with their names."""
    long = [n for n in value.shape if n > 1]
    for index in list(np.ndindex(*value.shape))[:MOST_CELLS]:
        places = [i + 1 for i, n in zip(index, value.shape, strict=True) if n > 1 or not long]
        number = ",".join(map(str, places if long else places[:1]))
        yield (f"{name}[{number}]" if numbered else name), value[index]
