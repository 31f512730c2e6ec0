"""The force to quote of every plateau, what x and y give alone, and how far it is from as set up.

In `forces` the force to quote stands in every row of a bead and plateau: one number, and not one
measurement per axis. What agrees or does not are the forces of single axes (`force_axis`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from mtpipe.report import words
from mtpipe.report.folder import records

LATERAL = ("x", "y")
# The `force_status` of a plateau that a reader has left out.
EXCLUDED = "excluded"
PARTS = ("", "_stderr", "_low", "_high")


@dataclass(frozen=True)
class Comparison:
    """The force to quote of one plateau, and those of x and y alone, in pN.

    Attributes
    ----------
    alone : by axis, (value, standard error, low, high); axes without one are left out.
    """

    plateau: int
    given: float
    given_stderr: float
    alone: Mapping[str, tuple[float, float, float, float]]

    @property
    def difference(self) -> tuple[float, float] | None:
        """Force from x less force from y, and its standard error if theirs are independent."""
        if not {"x", "y"} <= self.alone.keys():
            return None
        (x, x_stderr, *_), (y, y_stderr, *_) = self.alone["x"], self.alone["y"]
        stderr = math.hypot(x_stderr, y_stderr)
        return (x - y, stderr) if stderr > 0 and math.isfinite(stderr) else None


@dataclass(frozen=True)
class Change:
    """A plateau's force by the setup as it was configured, and the one to quote, in pN."""

    plateau: int
    magnet_mm: float
    before: float
    before_stderr: float
    after: float
    after_stderr: float

    @property
    def ratio(self) -> float:
        """Force to quote over the one as configured."""
        return self.after / self.before


def quoted(forces: pd.DataFrame) -> pd.DataFrame:
    """Rows of `forces`, one for each bead and plateau that has a force to quote and is not left out
    by hand.
    """
    lateral = forces[forces["axis"].isin(LATERAL)].sort_values(["plateau", "axis"])
    there = lateral["force_pN"].notna() & (lateral["force_status"] != EXCLUDED)
    return lateral[there].drop_duplicates(["bead", "plateau"])


def largest_change(forces: pd.DataFrame) -> Change | None:
    """The plateau of one bead whose force differs most from the one as configured, as a ratio.

    None where no plateau has both.
    """
    changes = [
        Change(
            int(row["plateau"]),
            row["magnet_mm"],
            row["force_configured_pN"],
            row["force_configured_stderr_pN"],
            row["force_pN"],
            row["force_stderr_pN"],
        )
        for row in records(quoted(forces))
        if _is_force(row["force_configured_pN"]) and _is_force(row["force_pN"])
    ]
    return max(changes, key=lambda one: abs(math.log(one.ratio)), default=None)


def comparisons(forces: pd.DataFrame) -> list[Comparison]:
    """Each plateau of one bead that has a force to quote and its error, in their order."""
    lateral = records(forces[forces["axis"].isin(LATERAL)])
    return [
        Comparison(
            plateau=int(row["plateau"]),
            given=row["force_pN"],
            given_stderr=row["force_stderr_pN"],
            alone={
                other["axis"]: four
                for other in lateral
                if other["plateau"] == row["plateau"]
                and all(map(words.is_number, four := _alone(other)))
            },
        )
        for row in records(quoted(forces))
        if _is_force(row["force_pN"]) and words.is_number(row["force_stderr_pN"])
    ]


def _is_force(value: Any) -> bool:
    return words.is_number(value) and value > 0


def rms_difference(compared: Sequence[Comparison]) -> tuple[float, int] | None:
    """Root mean square of x less y in standard errors, and over how many plateaus."""
    seen = [one.difference for one in compared if one.difference is not None]
    if not seen:
        return None
    return math.sqrt(sum((value / stderr) ** 2 for value, stderr in seen) / len(seen)), len(seen)


def _alone(row: Mapping[str, Any]) -> tuple[float, float, float, float]:
    value, stderr, low, high = (row[f"force_axis{part}_pN"] for part in PARTS)
    return value, stderr, low, high
