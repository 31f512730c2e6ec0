"""Whether the columns of a run's tables hold what their names say: words, numbers, yes or no."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from mtpipe.recording import AXES
from mtpipe.report.contents import LARGEST
from mtpipe.report.words import MODEL, VERDICT_MARK

WORDS = frozenset(
    (
        *("bead", "axis", "status", "tied_to", "method", "flags", "refusal", "verdict", "reasons"),
        *("tether_model", "series", "model", "statistic", "stage", "reason"),
    )
)
YES_OR_NO = frozenset(("posterior_converged", "used", "recommended", "extrapolated"))
NEVER_EMPTY = frozenset(("bead", "axis", "verdict", "stage", "model", "statistic", "method"))
CHOICES = {"verdict": VERDICT_MARK, "stage": ("raw", "subtracted"), "model": MODEL}
# Of curves, which are drawn from these.
POSITIVE = frozenset(
    (
        *("contour_length_nm", "persistence_length_nm", "stretch_modulus_pN"),
        *("force_low_pN", "force_high_pN"),
    )
)


def check(table: pd.DataFrame, columns: Sequence[str], several_axes: bool) -> None:
    """Look at every column that the report reads.

    Parameters
    ----------
    several_axes : `axis` may name more than one, and `plateau` be empty: all of them.

    Raises
    ------
    ValueError : a column is missing, or holds something else than its name says.
    """
    missing = [name for name in columns if name not in table.columns]
    if missing or not table.columns.is_unique:
        wrong = f"lacks the column{'s' * (len(missing) > 1)} {', '.join(missing)}"
        raise ValueError(wrong if missing else "has two columns of one name")
    for name in columns:
        column = table[name]
        present = column[column.notna()]
        if name in NEVER_EMPTY and len(present) < len(column):
            raise ValueError(f"column {name} has empty cells")
        if len(present) and not _is_of_its_kind(name, present):
            raise ValueError(f"column {name} holds {column.dtype} where {_kind(name)} are expected")
        if name not in WORDS | YES_OR_NO:
            finite = present[np.isfinite(present)]
            lowest = 0.0 if "model" in columns and name in POSITIVE else -LARGEST
            if not finite.between(lowest, LARGEST, inclusive="right").all():
                raise ValueError(f"column {name} holds numbers that cannot be")
        if name in CHOICES and not present.isin(CHOICES[name]).all():
            raise ValueError(f"column {name} holds other words than {', '.join(CHOICES[name])}")
    if "axis" in columns and not several_axes and not table["axis"].isin(AXES).all():
        raise ValueError("column axis holds other words than x, y, z")
    if "plateau" in columns:
        _check_plateaus(table["plateau"], several_axes)


def _is_of_its_kind(name: str, present: pd.Series) -> bool:
    if name in WORDS:
        return all(isinstance(one, str) for one in present)
    if name in YES_OR_NO:
        return all(isinstance(one, (bool, np.bool_)) for one in present)
    return pd.api.types.is_numeric_dtype(present) and not pd.api.types.is_bool_dtype(present)


def _kind(name: str) -> str:
    return "words" if name in WORDS else "true and false" if name in YES_OR_NO else "numbers"


def _check_plateaus(plateaus: pd.Series, may_be_empty: bool) -> None:
    present = plateaus.dropna()
    whole = bool(((present >= 0) & (present == np.floor(present))).all()) if len(present) else True
    if not whole or (len(present) < len(plateaus) and not may_be_empty):
        raise ValueError("column plateau holds something else than numbers of plateaus")
