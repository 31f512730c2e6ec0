"""Cells of a text file: which are numbers, which say that there is none, which are clock times."""

from __future__ import annotations

import re
from collections.abc import Collection
from functools import cache

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from mtpipe.ingest.instants import are_instants, instants_of, is_instant

# Ways to write that there is no number, of C's libraries, of spreadsheets and of languages.
# Infinity is none either.
NO_NUMBER = re.compile(
    r"""
    \W*                                     # empty, or signs alone: --, ?, ***
    | [+-]?1[.,][#$]\w*(?:[+-]\d+)?         # Microsoft's C: -1.#IND00, 1.#QNAN, -1.#IO, -1.$
    # other C, IEEE 754: nan, -nan(ind), NaNQ, nan0x7, NaN nm
    | [+-]?\W?[sq]?nan(?:[qs]|0x\w+|\d+)?(?:\W.*)?
    | [+-]?(?:inf(?:inity)?|∞)\W*
    # N/A, n.d., #N/A, <NA>, NULL, NaT
    | \W*(?:n\W?[ad]\W?|null|none|nil|nat|undef(?:ined)?|missing|no\W?(?:data|value))\W*
    | \#n/a\W.*|\\n                         # of Bloomberg's and of databases
    | \#[\w/]+[!?]                          # spreadsheets: #NUM!, #DIV/0!, #WERT!
    """,
    re.VERBOSE | re.IGNORECASE,
)
# Those that pyarrow passes over by itself, for speed; all others take a second look at the block.
COMMON = ("", "nan", "NaN", "NAN", "-nan", "NA", "-1.#IND", "-1.#IND00", "-1.#IND000")
# In one way only: a cell of many digits would be tried in each of several.
NUMBER = r"^[+-]?(?:\d+(?:{mark}\d*)?|{mark}\d+)(?:[eEdD][+-]?\d+)?$"
MINUS_SIGN = "\N{MINUS SIGN}"


def is_no_number(cell: str, lost_tokens: Collection[str] = ()) -> bool:
    """Whether a cell says that there is no number, by rule or by the setup's `lost.tokens`."""
    word = cell.strip()
    return NO_NUMBER.fullmatch(word) is not None or word in {t.strip() for t in lost_tokens}


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a finite number as it is read with this decimal mark."""
    return _number(decimal).match(cell.strip().replace(MINUS_SIGN, "-")) is not None


@cache
def _number(decimal: str) -> re.Pattern[str]:
    return re.compile(NUMBER.replace("{mark}", re.escape(decimal)))


def is_value(cell: str, decimal: str, lost_tokens: Collection[str] = ()) -> bool:
    """Whether a cell can stand in a column of numbers or clock times."""
    return is_number(cell, decimal) or is_no_number(cell, lost_tokens) or is_instant(cell)


def values_of_cells(
    cells: pa.ChunkedArray, decimal: str, lost_tokens: Collection[str]
) -> NDArray[np.generic] | None:
    """Values (n,) of a column of text; None if a cell is neither a number nor says there is none.

    Returns
    -------
    float64, NaN for what is no number; or datetime64[ns] if the cells are clock times.
    """
    trimmed = pc.replace_substring(pc.utf8_trim_whitespace(cells), MINUS_SIGN, "-")
    trimmed = pc.fill_null(trimmed, "")
    rule = NUMBER.replace("{mark}", re.escape(decimal))
    numeric = pc.match_substring_regex(trimmed, rule)
    others = pc.unique(pc.filter(trimmed, pc.invert(numeric))).to_pylist()
    rest = [cell for cell in others if not is_no_number(cell, lost_tokens)]
    if rest:
        if pc.any(numeric).as_py() or not are_instants(rest):
            return None
        return instants_of(trimmed.to_pylist())
    plain = pc.replace_substring_regex(trimmed, r"^\+", "")
    plain = pc.replace_substring_regex(plain, "[dD]", "e")
    if decimal != ".":
        plain = pc.replace_substring(plain, decimal, ".")
    known = pc.if_else(numeric, plain, pa.scalar(None, pa.string()))
    return np.asarray(known.cast(pa.float64()).to_numpy(), dtype=np.float64)
