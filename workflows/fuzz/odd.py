"""Odd names, values and arrays, of which files of another structure are made."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

Random = np.random.Generator
NAMES = (
    "", " ", "a\nb", "a\r\nb", "\t", "\x1b[31mred", "\x85", "\u2028", "ü", "名", "x" * 300, "a/b",
    ".", "..", "/", "{n}", "{name}", "%s", "[1]", "a[0]", "=1+1", "-", "'", '"', "a,b", "\ufeff",
    "nan", "None", "True", "__class__", "Time", "time_s", "b1_x_nm", "b1_x_nm ", "ref1_z_nm",
    "magnet_mm", "frame", "{", "}", "{0}", "\\", "\x7f",
)  # fmt: skip
WORDS = (*NAMES, "nm", "um", "pixel", "s", "ms", "unknown", "take", "text", "1e999", "0x10", "١٢")
NUMBERS = (
    0, 1, -1, 2, 3.5, -0.0, 1e-300, 1e300, math.nan, math.inf, -math.inf, 2**31, 2**63, -(2**63),
    2**64 - 1, 10**30,
)  # fmt: skip
DTYPES = (
    "f8", "f8", "f8", ">f8", "f4", "f2", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "?", "c16",
    "S5", "U3",
)  # fmt: skip
RARE_DTYPES = ("M8[ns]", "M8[s]", "M8[D]", "m8[ms]", "V4", "O", "g", "records", "nested")
ROWS = (0, 1, 2, 7, 60, 60, 60, 61, 120)


def pick(random: Random, choices: Any) -> Any:
    """One of several."""
    return choices[int(random.integers(len(choices)))]


def odd_name(random: Random) -> str:
    """A name that a column may have."""
    return str(pick(random, NAMES))


def odd_value(random: Random, depth: int = 2) -> Any:
    """A value that JSON or TOML can hold."""
    kind = random.integers(7 if depth else 5)
    if kind == 0:
        return pick(random, (None, True, False))
    if kind <= 2:
        return pick(random, NUMBERS)
    if kind <= 4:
        return pick(random, WORDS)
    count = int(random.integers(4))
    if kind == 5:
        return [odd_value(random, depth - 1) for _ in range(count)]
    return {odd_name(random): odd_value(random, depth - 1) for _ in range(count)}


def shape_of(random: Random) -> tuple[int, ...]:
    """A shape, mostly of one side with 60 rows."""
    n = pick(random, ROWS)
    return tuple(
        pick(
            random,
            (
                (n,),
                (n,),
                (n,),
                (),
                (1, n),
                (n, 1),
                (n, 3),
                (3, n),
                (n, 2, 3),
                (n, 0),
                (1, 1),
                (1, 1, 1, n),
            ),
        )
    )


def odd_array(random: Random, *, rare: bool = True) -> np.ndarray[Any, Any]:
    """An array of any type and shape.

    Parameters
    ----------
    rare : whether types count that only numpy's files have.
    """
    shape = shape_of(random)
    kind = pick(random, DTYPES + RARE_DTYPES if rare else DTYPES)
    if kind == "records":
        records = np.zeros(
            shape, [("x", "f8"), (pick(random, ("y", "ü")), "i4"), ("z", "f4", (2,))]
        )
        records["x"] = random.normal(size=shape)
        return records
    if kind == "nested":
        return np.zeros(shape, [("a", [("b", "f8"), ("c", "S3")]), ("d", "O")])
    return array_of(random, kind, shape)


def array_of(random: Random, kind: str, shape: tuple[int, ...]) -> np.ndarray[Any, Any]:
    """An array of a type and shape, at times with values that are no positions."""
    values = np.cumsum(random.normal(size=shape), axis=0) if shape else random.normal(size=shape)
    with np.errstate(all="ignore"):
        way = random.integers(8)
        if way == 0:
            values = np.full(shape, float(pick(random, NUMBERS)))
        elif way == 1:
            values = np.where(random.random(shape) < 0.3, float(pick(random, NUMBERS)), values)
        elif way == 2:
            values = np.arange(math.prod(shape), dtype=float).reshape(shape) / 100
        elif way == 3:
            values = values * 1e18
        dtype = np.dtype(kind)
        if dtype.kind == "V":
            return np.zeros(shape, dtype)
        if dtype.kind in "Mm":
            whole = np.fmod(np.nan_to_num(values, posinf=1e9, neginf=-1e9), 1e9).astype("i8")
            return whole.astype("M8[s]" if dtype.kind == "M" else "m8[s]").astype(dtype)
        if dtype.kind in "iu":
            values = np.nan_to_num(values, posinf=1e9, neginf=-1e9)
        if dtype.kind == "O":
            objects = np.empty(shape, object)
            objects[...] = pick(random, (None, "text", 1.5))
            return objects
        if dtype.kind == "S":
            return np.full(shape, pick(random, WORDS).encode()).astype(dtype)
        if dtype.kind == "U":
            return np.full(shape, pick(random, WORDS)).astype(dtype)
        return np.asarray(values.astype(dtype))
