"""Compilation of the inner loops with numba, in one place.

This is the only module that imports numba, so whoever imports a simulator pays for it and whoever
imports mtpipe does not. No fast-math: the order of floating-point operations is the written one,
which keeps the numbers of a seed the same on every machine. The compiled code is kept on disk next
to the module, or in the user's cache folder where that one cannot be written.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """The function as machine code; its type, for whoever calls it, stays the same."""
    return cast(Function, numba.njit(cache=True)(function))
