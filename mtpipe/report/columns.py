"""Whether the columns of a run's tables hold what their names say: words, numbers, yes or no."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from mtpipe.recording.recording import AXES
from mtpipe.report.contents import DIAGNOSES, LARGEST
from mtpipe.report.words import MODEL, VERDICT_MARK

WORDS = frozenset(
    (
        *("bead", "axis", "status", "tied_to", "method", "flags", "refusal", "verdict", "reasons"),
        *("tether_model", "series", "model", "statistic", "stage", "reason"),
        *("force_source", "force_status", "mismatch"),
    )
)
YES_OR_NO = frozenset(("posterior_converged", "used", "recommended", "extrapolated", "material"))
COUNTS = frozenset(
    (
        "plateau",
        "plateaus",
        "plateaus_used",
        "other_plateau",
        "frames",
        "lost_frames",
        "points",
        "simulations",
    )
)
NEVER_EMPTY = frozenset(
    (
        *("bead", "axis", "verdict", "stage", "model", "statistic", "method"),
        *("start_s", "duration_s", "recommended", "used", "material", "frequency_hz", *COUNTS),
    )
)
CHOICES = {
    "verdict": VERDICT_MARK,
    "mismatch": ("", *DIAGNOSES),
    "stage": ("raw", "subtracted"),
    "model": MODEL,
}
POSITIVE = frozenset(("frequency_hz",))
# Lengths of chains and forces of curves, in the table that has a row per `model`.
POSITIVE_OF_CURVES = frozenset(("contour_length_nm", "persistence_length_nm", "stretch_modulus_pN"))
FORCES_OF_CURVES = frozenset(("force_low_pN", "force_high_pN"))


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
    if missing:
        raise ValueError(f"lacks the column{'s' * (len(missing) > 1)} {', '.join(missing)}")
    if not table.columns.is_unique:
        raise ValueError("has two columns of one name")
    for name in columns:
        present = table[name].dropna()
        may_be_empty = name not in NEVER_EMPTY or (name == "plateau" and several_axes)
        may_be_empty &= name != "p_value" or "statistic" not in columns
        if len(present) < len(table) and not may_be_empty:
            raise ValueError(f"column {name} has empty cells")
        if len(present):
            _check_kind(name, present)
            _check_values(name, present, of_curves="model" in columns)
    if "axis" in columns and not several_axes and not table["axis"].isin(AXES).all():
        raise ValueError("column axis holds other words than x, y, z")


def _check_kind(name: str, present: pd.Series) -> None:
    """Raise ValueError if the cells that are not empty are of another type than they should."""
    types = pd.api.types
    if name in WORDS:
        fits, kind = types.infer_dtype(present) == "string", "words"
    elif name in YES_OR_NO:
        fits, kind = types.infer_dtype(present) == "boolean", "true and false"
    else:
        fits = types.is_numeric_dtype(present) and not types.is_bool_dtype(present)
        kind = "numbers"
    if not fits:
        raise ValueError(f"column {name} holds {present.dtype} where {kind} are expected")


def _check_values(name: str, present: pd.Series, of_curves: bool) -> None:
    """Raise ValueError if a cell holds what cannot be."""
    if name in CHOICES and not present.isin(list(CHOICES[name])).all():
        raise ValueError(f"column {name} holds other words than {', '.join(CHOICES[name])}")
    if name in WORDS | YES_OR_NO:
        return
    numbers = present.to_numpy(dtype=float)
    finite = np.isfinite(numbers)  # infinite: an interval has no end there
    possible = np.abs(numbers) < LARGEST
    if name in NEVER_EMPTY:
        finite[:] = True
    if name in COUNTS:
        possible &= (numbers >= 0) & (numbers == np.floor(numbers))
    elif of_curves and name in FORCES_OF_CURVES:
        possible &= numbers > 0
        finite[:] = True
    elif name in POSITIVE or (of_curves and name in POSITIVE_OF_CURVES):
        possible &= numbers > 0
    if not possible[finite].all():
        raise ValueError(f"column {name} holds numbers that cannot be")
