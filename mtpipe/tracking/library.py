"""magtrack, the field's own tracking library, without what its import does to the whole program.

magtrack 1.0 switches numpy's floating-point warnings off, and warns that it found no GPU, when it
is imported. Both are kept inside this module. Stacks go to magtrack as (row, column, image), by way
of the GPU where cupy finds one: magtrack's functions stay wherever their arrays are.
"""

from __future__ import annotations

import functools
import importlib
import warnings
from typing import Any

import numpy as np

from mtpipe.ground.types import FloatArray


@functools.cache
def magtrack() -> Any:
    """The library."""
    with warnings.catch_warnings(), np.errstate():
        warnings.simplefilter("ignore")
        return importlib.import_module("magtrack")


@functools.cache
def optics() -> Any:
    """The library's optical model of a bead."""
    magtrack()
    return importlib.import_module("magtrack.simulation")


def stack_of(images: FloatArray) -> Any:
    """Images (n, size, size) as (size, size, n), on the GPU if there is one."""
    return on_device(np.moveaxis(images, 0, 2))


def on_device(array: FloatArray) -> Any:
    """An array where magtrack works on it: on the GPU if there is one."""
    if not magtrack().check_cupy():
        return array
    return importlib.import_module("cupy").asarray(np.ascontiguousarray(array))


def from_device(array: Any) -> FloatArray:
    """An array of magtrack's in the computer's own memory."""
    if not magtrack().check_cupy():
        return np.asarray(array, dtype=float)
    return np.asarray(importlib.import_module("cupy").asnumpy(array), dtype=float)
