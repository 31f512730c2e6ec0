"""The cross-check of a whole recording, bead by bead, and its table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from mtpipe.crosschecking.beads import check_of, per_bead
from mtpipe.crosschecking.check import BeadCheck
from mtpipe.ground.processes import Workers, executor
from mtpipe.ground.progress import of_step
from mtpipe.ground.shown import Shown
from mtpipe.ground.steps import finished
from mtpipe.ground.types import Progress
from mtpipe.ground.written_numbers import number
from mtpipe.recording.recording import Recording
from mtpipe.states import with_states

INTERVAL_95 = (0.025, 0.975)
COLUMNS = (
    "bead", "statistic", "axis", "plateau", "magnet_mm", "band_low_hz", "band_high_hz",
    "time_low_s", "time_high_s", "value", "simulated_median", "simulated_low", "simulated_high",
    "p_value", "extrapolated", "simulations", "bead_p_value",
)  # fmt: skip


@dataclass(frozen=True)
class CrossCheck(Shown):
    """A recording beside simulations of its configured experiment.

    Attributes
    ----------
    recording : its name.
    beads : the check of each tethered bead that could be simulated.
    refused : what is wrong with the data of others.
    failed : faults of the program at others, in words.
    """

    recording: str
    beads: Mapping[str, BeadCheck]
    refused: Mapping[str, str]
    failed: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        found = [f"{bead} p = {number(one.p_value, 2)}" for bead, one in self.beads.items()]
        refused = [f"{bead} not simulated" for bead in self.refused]
        return f"CrossCheck of {self.recording}: {', '.join([*found, *refused]) or 'no beads'}"

    @property
    def table(self) -> pd.DataFrame:
        """A row per statistic, bead, plateau and axis: value, simulated distribution, p-value.

        Rows of statistics that take several plateaus together have no plateau. `p_value` is that
        of the row alone; `bead_p_value` that of the whole bead, corrected for the number of rows.
        `extrapolated`: smaller than the number of simulations supports without a fitted tail.
        """
        rows = [row for check in self.beads.values() for row in _rows(check)]
        table = pd.DataFrame(rows, columns=list(COLUMNS))
        return table.astype({"plateau": "Int64"})


def crosscheck(
    recording: Recording,
    *,
    seed: int = 0,
    workers: Workers = 1,
    progress: Progress | None = None,
) -> CrossCheck:
    """Compare every tethered bead of a recording with simulations of the configured experiment.

    Parameters
    ----------
    recording : with the drift subtracted (`mtpipe.subtract_drift`).
    seed : of the simulations; each bead's own derives from it.
    workers : processes, or an executor, over which beads are spread. More than one process needs
        the usual guard `if __name__ == "__main__":` in a script that calls this.
    progress : called with (beads done, of how many); default: a bar in a notebook.

    Raises
    ------
    Nothing for what goes wrong at one bead: that is in `refused` or `failed`.
    """
    recording = with_states(recording)
    say = of_step(progress, "comparing beads with simulations")
    with executor(workers, most=len(recording.tethered)) as pool:
        found = finished(per_bead(recording, _check, pool, seed=seed, progress=say))
    return CrossCheck(recording.name, found.results, found.refused, found.failed)


def _check(recording: Recording, bead: str, random: np.random.Generator) -> BeadCheck:
    return check_of(recording, bead, random, with_curves=True)


def _rows(check: BeadCheck) -> list[dict[str, object]]:
    median = np.median(check.simulated, axis=0)
    low, high = np.quantile(check.simulated, INTERVAL_95, axis=0)
    smallest = 1 / (len(check.simulated) + 1)
    rows: list[dict[str, object]] = []
    for i, statistic in enumerate(check.statistics):
        plateau = None if statistic.pooled else check.case.plateaus[statistic.plateaus[0]]
        rows.append(
            {
                "bead": check.case.bead,
                "statistic": statistic.kind,
                "axis": statistic.axis,
                "plateau": None if plateau is None else plateau.number,
                "magnet_mm": None if plateau is None else plateau.magnet_mm,
                "band_low_hz": None if statistic.band_hz is None else statistic.band_hz[0],
                "band_high_hz": None if statistic.band_hz is None else statistic.band_hz[1],
                "time_low_s": None if statistic.time_s is None else statistic.time_s[0],
                "time_high_s": None if statistic.time_s is None else statistic.time_s[1],
                "value": check.observed[i],
                "simulated_median": median[i],
                "simulated_low": low[i],
                "simulated_high": high[i],
                "p_value": check.p_values[i],
                "extrapolated": bool(check.p_values[i] < smallest),
                "simulations": len(check.simulated),
                "bead_p_value": check.p_value,
            }
        )
    return rows
