"""The cross-check of a whole recording, bead by bead, and its table."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from mtpipe.crosschecking.case import prepare
from mtpipe.crosschecking.check import BeadCheck, check_bead
from mtpipe.crosschecking.listed import with_listed
from mtpipe.errors import MtpipeError
from mtpipe.processes import executor
from mtpipe.recording import Recording

Progress = Callable[[int, int], None]
INTERVAL_95 = (0.025, 0.975)
COLUMNS = (
    "bead", "statistic", "axis", "plateau", "magnet_mm", "band_low_hz", "band_high_hz",
    "time_low_s", "time_high_s", "value", "simulated_median", "simulated_low", "simulated_high",
    "p_value", "extrapolated", "simulations", "bead_p_value",
)  # fmt: skip


@dataclass(frozen=True)
class CrossCheck:
    """A recording beside simulations of its configured experiment.

    Attributes
    ----------
    recording : its name.
    beads : the check of each tethered bead that could be simulated.
    refused : why the others could not.
    """

    recording: str
    beads: Mapping[str, BeadCheck]
    refused: Mapping[str, str]

    @property
    def table(self) -> pd.DataFrame:
        """A row per statistic, bead, plateau and axis: value, simulated distribution, p-value.

        Rows of statistics that take several plateaus together have no plateau. `p_value` is that
        of the row alone; `bead_p_value` that of the whole bead, all looks accounted for.
        `extrapolated`: smaller than the number of simulations supports without a fitted tail.
        """
        rows = [row for check in self.beads.values() for row in _rows(check)]
        table = pd.DataFrame(rows, columns=list(COLUMNS))
        return table.astype({"plateau": "Int64"})


def crosscheck(
    recording: Recording,
    *,
    seed: int = 0,
    workers: int = 1,
    progress: Progress | None = None,
) -> CrossCheck:
    """Compare every tethered bead of a recording with simulations of the configured experiment.

    Parameters
    ----------
    recording : with the drift subtracted (`mtpipe.subtract_drift`).
    seed : of the simulations; each bead's own derives from it.
    workers : processes, over which beads are spread. More than one needs the usual guard
        `if __name__ == "__main__":` in a script that calls this.
    progress : called with (beads done, of how many).
    """
    beads = recording.tethered
    say = progress or (lambda done, total: None)
    say(0, len(beads))
    checks: dict[str, BeadCheck] = {}
    refused: dict[str, str] = {}
    with executor(min(workers, len(beads))) as pool:
        done = itertools.count(1)
        futures = {}
        for bead in beads:
            futures[bead] = pool.submit(_check, alone(recording, bead), bead, seed)
            futures[bead].add_done_callback(lambda _: say(next(done), len(beads)))
        for bead, future in futures.items():
            outcome = future.result()
            if isinstance(outcome, BeadCheck):
                checks[bead] = outcome
            else:
                refused[bead] = outcome
    return CrossCheck(recording.name, checks, refused)


def _check(recording: Recording, bead: str, seed: int) -> BeadCheck | str:
    """The check of a bead, or in words why there is none."""
    try:
        case = with_listed(prepare(recording, bead), recording.setup)
        return check_bead(case, bead_generator(seed, bead), with_curves=True)
    except (MtpipeError, ValueError, np.linalg.LinAlgError) as error:
        return str(error)


def alone(recording: Recording, bead: str) -> Recording:
    """The recording with this tethered bead only, which is all that its check reads."""
    kept = (bead, *recording.setup.beads.reference)
    return replace(
        recording,
        positions_nm={name: xyz for name, xyz in recording.positions_nm.items() if name in kept},
    )


def bead_generator(seed: int, bead: str) -> np.random.Generator:
    """A generator of the bead's own, the same whatever other beads there are."""
    digest = hashlib.sha256(f"crosscheck {bead}".encode()).digest()
    return np.random.default_rng([seed, int.from_bytes(digest[:8], "little")])


def _rows(check: BeadCheck) -> list[dict[str, object]]:
    median = np.median(check.simulated, axis=0)
    low, high = np.quantile(check.simulated, INTERVAL_95, axis=0)
    smallest = 1 / (len(check.simulated) + 1)
    rows: list[dict[str, object]] = []
    for i, look in enumerate(check.looks):
        plateau = None if look.pooled else check.case.plateaus[look.plateaus[0]]
        rows.append(
            {
                "bead": check.case.bead,
                "statistic": look.statistic,
                "axis": look.axis,
                "plateau": None if plateau is None else plateau.number,
                "magnet_mm": None if plateau is None else plateau.magnet_mm,
                "band_low_hz": None if look.band_hz is None else look.band_hz[0],
                "band_high_hz": None if look.band_hz is None else look.band_hz[1],
                "time_low_s": None if look.time_s is None else look.time_s[0],
                "time_high_s": None if look.time_s is None else look.time_s[1],
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
