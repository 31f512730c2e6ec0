"""Forces of the beads of many recordings, as the curve is fitted to them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mtpipe.ground.types import FloatArray

# Positions are stored to a micrometre: motors of magnets repeat to no less.
DECIMALS_MM = 3
# Largest relative error of a force in the fit: beyond, its logarithm is far from normal and tells
# next to nothing.
MOST_RELATIVE_ERROR = 0.5


@dataclass(frozen=True)
class Forces:
    """Forces of beads at positions of the magnets.

    Attributes
    ----------
    beads : (recording, bead) by number. The same name in two recordings is two beads.
    bead : (n,) number of each force's bead.
    position_mm, force_pN, stderr_pN : (n,); forces are positive, errors too.
    """

    beads: tuple[tuple[str, str], ...]
    bead: NDArray[np.int64]
    position_mm: FloatArray
    force_pN: FloatArray
    stderr_pN: FloatArray

    @property
    def log_force(self) -> FloatArray:
        """Natural logarithm of the forces in pN, (n,)."""
        return np.asarray(np.log(self.force_pN))

    @property
    def variance(self) -> FloatArray:
        """(n,) variance of the logarithms, by the forces' own errors."""
        return np.asarray((self.stderr_pN / self.force_pN) ** 2)

    @property
    def positions_mm(self) -> FloatArray:
        """Every position there is, once, in rising order."""
        return np.unique(self.position_mm)

    def sums(self, values: FloatArray) -> FloatArray:
        """Sum over each bead's forces of (n,) or (n, k) values: (beads,) or (beads, k)."""
        totals = np.zeros((len(self.beads), *values.shape[1:]))
        np.add.at(totals, self.bead, values)
        return totals

    def only(self, kept: NDArray[np.bool_]) -> Forces:
        """Those of some beads, (beads,) bool."""
        numbers = np.cumsum(kept) - 1
        mine = kept[self.bead]
        beads = tuple(one for one, keep in zip(self.beads, kept, strict=True) if keep)
        rows = (self.position_mm[mine], self.force_pN[mine], self.stderr_pN[mine])
        return Forces(beads, numbers[self.bead[mine]], *rows)

    def with_errors_times(self, factor: float) -> Forces:
        """The same forces with larger errors."""
        return replace(self, stderr_pN=self.stderr_pN * factor)


def measured_forces(tables: Iterable[tuple[str, pd.DataFrame]]) -> Forces:
    """Forces that can be used, of the forces tables of many recordings.

    Those count whose `force_status` is "ok" and whose magnet position is known and agrees with the
    beads (`magnet_believed`). One whose error is more than half of it tells nothing here.

    Parameters
    ----------
    tables : (name of the recording, its table as in `forces.parquet`).
    """
    columns = ["recording", "bead", "position_mm", "force_pN", "force_stderr_pN"]
    parts = [pd.DataFrame(columns=columns)]
    for name, table in tables:
        mine = table[(table["force_status"] == "ok") & table["magnet_believed"].astype(bool)]
        mine = mine.drop_duplicates(["bead", "plateau"]).rename(
            columns={"magnet_mm": "position_mm"}
        )
        parts.append(mine.assign(recording=name)[columns])
    every = pd.concat([part for part in parts if len(part)] or parts, ignore_index=True)
    numbers = every[columns[2:]].to_numpy(np.float64)
    with np.errstate(invalid="ignore"):
        good = (
            np.isfinite(numbers).all(axis=1)
            & (numbers[:, 1:] > 0).all(axis=1)
            & (numbers[:, 2] < MOST_RELATIVE_ERROR * numbers[:, 1])
        )
    names = list(zip(every["recording"][good], every["bead"][good], strict=True))
    beads = tuple(dict.fromkeys(names))
    number = {bead: n for n, bead in enumerate(beads)}
    position, force, stderr = numbers[good].T
    return Forces(
        beads,
        np.array([number[name] for name in names], dtype=np.int64),
        np.round(position, DECIMALS_MM),
        force,
        stderr,
    )
