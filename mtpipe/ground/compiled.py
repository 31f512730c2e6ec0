"""Compilation of the inner loops with numba, in one place.

This is the only module that imports numba, so whoever imports a simulator pays for it and whoever
imports mtpipe does not. No fast-math: the order of floating-point operations is the written one,
which keeps the numbers of a seed the same on every machine. What is divided by zero is infinite, as
in numpy: a loop that has to look at each divisor does one number at a time. The compiled code is
kept on disk next to the module, or in the user's cache folder where that one cannot be written;
where neither can, the disc is full or the user has no home, it is compiled again by every process.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.caching import FunctionCache

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """The function as machine code; its type, for whoever calls it, stays the same."""
    dispatcher: Any = numba.njit(error_model="numpy")(function)
    # numba raises RuntimeError where it finds no folder that it may write
    with suppress(RuntimeError, OSError):
        Path.home()  # raises RuntimeError where there is none: numba would make a folder "~" here
        dispatcher._cache = _KeptWherePossible(function)
    return cast(Function, dispatcher)


class _KeptWherePossible(FunctionCache):
    """numba's folder of compiled code; what it cannot read or write costs time and nothing else."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except OSError:
            return None
        except Exception:  # half a file, as after a loss of power, raises anything
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)
