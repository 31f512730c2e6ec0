"""Forces as the report shows them: once per plateau where x and y share one, and x beside y.

In `forces` a force that x and y share stands in both rows. Drawn or counted twice it would look
like two measurements that agree; what agrees or does not is the force that each axis tells by
itself, in the columns `force_axis`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.report import words
from mtpipe.report.fit_words import joint_fit
from mtpipe.report.folder import records


@dataclass(frozen=True)
class Comparison:
    """Force of one plateau, and what x and y tell of it by themselves, in pN.

    Attributes
    ----------
    given, given_stderr : the force that x and y share; where they share none, that of the axis
        which is part of the joint fit, or the mean of both, weighted by their errors.
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


def share_a_force(rows: Sequence[Mapping[str, Any]]) -> bool:
    """Whether x and y of one plateau, given as its rows of `forces`, have one force between them.

    An axis that was left out of the joint fit has its own.
    """
    lateral = [
        row for row in rows if row["axis"] in ("x", "y") and words.is_number(row["force_pN"])
    ]
    fits = [joint_fit(row["method"]) for row in lateral]
    return len(lateral) == 2 and all(fit is not None and fit.force_shared for fit in fits)


def drawn_forces(forces: pd.DataFrame) -> pd.DataFrame:
    """Rows of `forces` to be drawn, with a column `source`: "x and y" for a shared force, once."""
    drawn = []
    usable = forces[forces["force_pN"].notna() & forces["axis"].isin(["x", "y"])]
    for _, rows in usable.sort_values(["plateau", "axis"]).groupby(["bead", "plateau"], sort=False):
        if share_a_force(records(rows)):
            drawn.append(rows.head(1).assign(source="x and y"))
        else:
            drawn.append(rows.assign(source=rows["axis"]))
    return pd.concat(drawn) if drawn else usable.assign(source="")


def comparisons(forces: pd.DataFrame) -> list[Comparison]:
    """Each plateau of one bead that has a force, in their order."""
    made = []
    for plateau, table in drawn_forces(forces).groupby("plateau"):
        known = records(table)
        joint = [row for row in known if joint_fit(row["method"])] or known
        value = np.array([row["force_pN"] for row in joint])
        weight = np.array([row["force_stderr_pN"] for row in joint]) ** -2.0
        if not (np.isfinite(weight).all() and value.min() > 0):
            continue
        here = records(forces[(forces["plateau"] == plateau) & forces["axis"].isin(["x", "y"])])
        made.append(
            Comparison(
                plateau=int(str(plateau)),
                given=float(weight @ value / weight.sum()),
                given_stderr=float(weight.sum() ** -0.5),
                alone={
                    row["axis"]: four
                    for row in here
                    if all(map(words.is_number, four := _alone(row)))
                },
            )
        )
    return made


def rms_difference(compared: Sequence[Comparison]) -> tuple[float, int] | None:
    """Root mean square of x less y in standard errors, and over how many plateaus."""
    seen = [one.difference for one in compared if one.difference is not None]
    if not seen:
        return None
    return math.sqrt(sum((value / stderr) ** 2 for value, stderr in seen) / len(seen)), len(seen)


def _alone(row: Mapping[str, Any]) -> tuple[float, float, float, float]:
    value, stderr, low, high = (row[f"force_axis{part}_pN"] for part in _PARTS)
    return value, stderr, low, high


_PARTS = ("", "_stderr", "_low", "_high")
