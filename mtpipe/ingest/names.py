"""Names of columns compared as people read them.

A micro sign and a Greek mu, a no-break space and a space, a letter with an accent in one sign or
in two, an invisible byte-order mark: what looks the same is the same name (Unicode normalisation
form NFKC; characters of the categories Cc and Cf are dropped).
"""

from __future__ import annotations

import unicodedata
from functools import cache


@cache
def plain(name: str) -> str:
    """A name as it is compared: normalised, without invisible characters, single blanks."""
    if name.isascii() and name.isprintable():  # nearly all cells of a table are
        return " ".join(name.split())
    folded = unicodedata.normalize("NFKC", name)
    shown = (" " if c.isspace() else c for c in folded)
    kept = "".join(c for c in shown if unicodedata.category(c) not in ("Cc", "Cf"))
    return " ".join(unicodedata.normalize("NFKC", kept).split())
