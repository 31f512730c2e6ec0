"""Tables for people, as CSV: no name in them is a formula to the spreadsheet that opens it."""

from __future__ import annotations

import pandas as pd

# Excel, LibreOffice and Google Sheets execute a cell that begins so (OWASP, CSV injection).
FORMULA_MARKS = ("=", "+", "-", "@", "\t", "\r", "\n")


def as_csv(table: pd.DataFrame) -> str:
    """A table as CSV; words that begin like a formula have an apostrophe before them."""
    words = table.select_dtypes(exclude=["number", "bool"])
    return table.assign(**{str(name): words[name].map(_harmless) for name in words}).to_csv(
        index=False
    )


def _harmless(cell: object) -> object:
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(FORMULA_MARKS) else cell
