"""Whether the last row of a text file, if no line end follows it, is whole.

A copy or a program that stops in the middle of a number leaves a number: 1023.2 becomes 10. Where
all rows are written with the same number of decimals that is certain, else only likely.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

from mtpipe.ingest.cells import is_no_number
from mtpipe.ingest.text_layout import split_line
from mtpipe.setup.source_parts import Delimiter

ROWS = 100
FEWEST = 3


@dataclass(frozen=True)
class Fault:
    """What is wrong with the last row, as in "its last row ..."; `certain` or only likely."""

    said: str
    certain: bool


def last_row_fault(
    last: bytes, earlier: bytes, delimiter: Delimiter, decimal: str, names: Sequence[str]
) -> Fault | None:
    """What is wrong with a last row without line end.

    Parameters
    ----------
    last : its bytes, blanks within it made tabs if those separate columns.
    earlier : rows before it, of which the last are compared.
    """
    if b"\0" in last:
        return Fault("ends in zero bytes where it was not written to the end", True)
    mark: Delimiter = "tab" if delimiter == "whitespace" else delimiter
    lines = re.split(r"\r\n|\r|\n", earlier[-(1 << 16) :].decode("utf-8", "replace"))
    try:
        cells = split_line(last.decode("utf-8", "replace"), mark)
        rows = [split_line(line, mark) for line in lines[1:] if line.strip()][-ROWS:]
    except csv.Error:  # no line of a table, which reading it says
        return None
    if len(cells) < len(names):
        return Fault(f"has {len(cells)} of {len(names)} columns: the file is cut off", True)
    at = len(cells) - 1
    column = [row[at] for row in rows if at < len(row) and not is_no_number(row[at])]
    if len(column) < FEWEST or (cells[at].strip() and is_no_number(cells[at])):
        return None
    if not cells[at].strip():
        always = len(column) == len(rows) and bool(names[at])
        return Fault("may be cut off, as its last cell is empty", False) if always else None
    written = [_precision(cell, decimal) for cell in column]
    here = _precision(cells[at], decimal)
    short = [here[k] < min(one[k] for one in written) for k in (0, 1)]
    if not any(short):
        return None
    fixed = all(len({one[k] for one in written}) == 1 for k in (0, 1) if short[k])
    if fixed:
        return Fault("is cut off in the middle of a number", True)
    return Fault("may be cut off, as its last number is shorter than all before it", False)


def _precision(cell: str, decimal: str) -> tuple[int, int]:
    """Digits after the decimal mark and of the exponent, -1 where there is none."""
    mantissa, e, exponent = cell.strip().casefold().replace("d", "e").partition("e")
    _, point, decimals = mantissa.partition(decimal)
    return (len(decimals) if point else -1, len(exponent) if e else -1)
