"""Cells of the report's tables: the text shown, its explanation and its sort key."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mtpipe.report import words


@dataclass(frozen=True)
class Cell:
    """What a cell shows; `note` is its interval, or the reason why it is empty.

    `rows` is how many rows of the table it spans; `below` stands in it in small type.
    """

    shown: str
    note: str = ""
    sort: float | None = None
    rows: int = 1
    below: str = ""

    @property
    def empty(self) -> bool:
        """Whether there is no value to show."""
        return self.shown == words.EMPTY


def estimate_cell(
    row: Mapping[str, Any], quantity: str, unit: str, why_empty: str, factor: float = 1.0
) -> Cell:
    """An estimate from its four columns, times a factor."""
    value, stderr, low, high = (
        math.nan if cell is None else factor * cell
        for cell in (row[f"{quantity}{part}_{unit}"] for part in ("", "_stderr", "_low", "_high"))
    )
    symbol = _SYMBOL.get(unit, unit)
    if words.is_number(value):
        shown = words.with_arms(value, stderr, low, high)
        return Cell(shown, words.interval(low, high, symbol), value)
    if words.is_number(low) and high == math.inf:
        return Cell(f"> {words.number(low)}", f"{why_empty}; lower limit at 68 %")
    remains = words.interval(low, high, symbol)
    return Cell(words.EMPTY, f"{why_empty}; {remains}" if remains else why_empty)


def plain_cell(value: Any, why_empty: str, digits: int = 4) -> Cell:
    """A number without an error."""
    shown = words.number(value, digits)
    return Cell(shown, why_empty if shown == words.EMPTY else "")


def error_cell(value: Any, stderr: Any, why_empty: str) -> Cell:
    """A value and its standard error."""
    if not words.is_number(value):
        return Cell(words.EMPTY, why_empty)
    return Cell(words.with_error(value, stderr), "", value)


_SYMBOL = {"pN_per_nm": "× 10⁻³ pN/nm", "pN_s_per_nm": "× 10⁻⁶ pN·s/nm", "hz": "Hz"}
