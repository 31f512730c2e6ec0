"""How a mean or a variance runs within a plateau where no effect explains it, and what that leaves
open about the force.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtpipe.crosschecking.battery.statistic import Statistic
from mtpipe.crosschecking.battery.temporal import WINDOWS, in_windows, stderr_of_windows
from mtpipe.crosschecking.check import BeadCheck, recorded_of
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.diagnosis.heldout import halves_of
from mtpipe.diagnosis.smooth_correction import WORTH_NATS
from mtpipe.diagnosis.smooth_curve import SmoothCurve, smooth_curve
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.fit import fit_configured
from mtpipe.recording.recording import AXES

Kind = Literal["mean", "variance"]
KINDS: dict[str, Kind] = {
    "mean_trend": "mean",
    "mean_step": "mean",
    "mean_excursion": "mean",
    "variance_trend": "variance",
    "variance_step": "variance",
    "variance_spread": "variance",
    "quietest_second": "variance",
}


@dataclass(frozen=True, eq=False)
class LeftInTime:
    """A course within a plateau.

    Attributes
    ----------
    axis, plateau : indices.
    values, stderr : (windows,) means about the plateau's in nm, or ln of variances over their mean.
    curve : smooth, over the seconds from the plateau's begin.
    halves : force in pN and its standard error, of the first and the second half of the plateau by
        themselves; None where these are too short, or the force changes as it is.
    """

    kind: Kind
    axis: int
    plateau: int
    values: FloatArray
    stderr: FloatArray
    curve: SmoothCurve
    halves: tuple[tuple[float, float], tuple[float, float]] | None

    @property
    def words(self) -> str:
        """A sentence, without the plateau's number."""
        ends = sorted((int(np.argmin(self.curve.mean)), int(np.argmax(self.curve.mean))))
        told = []
        for k in ends:
            size, error = float(self.curve.mean[k]), float(self.curve.stderr[k])
            if self.kind == "mean":
                told.append(f"{size:+.2g} ± {error:.1g} nm at {self.curve.at[k]:.3g} s")
            else:
                factor = np.exp(size)
                told.append(f"{factor:.2f} ± {factor * error:.2f} at {self.curve.at[k]:.3g} s")
        of = "the mean" if self.kind == "mean" else "the variance, over that of the plateau,"
        words = f"{of} runs from {told[0]} to {told[1]}"
        if self.halves is None:
            return words
        first, second = (f"{force:.3g} ± {error:.1g}" for force, error in self.halves)
        return f"{words}; alone, its first half gives a force of {first} pN, the second {second} pN"


def left_in_time(check: BeadCheck, statistic: Statistic) -> LeftInTime | None:
    """The course that a statistic judges, in the plateau where it is clearest; None if it is about
    none, or the course is not worth a curve.
    """
    kind = KINDS.get(statistic.kind)
    if kind is None:
        return None
    axis = AXES.index(statistic.axis)
    plateau = clearest_plateau(check, statistic)
    one = recorded_of(check.case)[plateau]
    means, logs = in_windows(one)
    if kind == "mean":
        values, error = means[axis], float(stderr_of_windows(one)[axis])
    else:
        values = logs[axis] - np.log(np.mean(np.exp(logs[axis])))
        error = _simulated_spread(check, axis, plateau)
    time_s = (np.arange(WINDOWS) + 0.5) / WINDOWS * one.duration_s
    stderr = np.full(WINDOWS, error)
    curve = smooth_curve(time_s, values, stderr)
    if curve.gain_nats < WORTH_NATS:
        return None
    halves = _halves_pN(check.case, plateau)
    return LeftInTime(kind, axis, plateau, values, stderr, curve, halves)


def clearest_plateau(check: BeadCheck, statistic: Statistic) -> int:
    """Index of the plateau in which the statistic differs most along its axis."""
    odd = {
        one.plateaus[0]: float(check.p_values[i])
        for i, one in enumerate(check.statistics)
        if (one.kind, one.axis, len(one.plateaus)) == (statistic.kind, statistic.axis, 1)
        and set(one.plateaus) <= set(statistic.plateaus)
    }
    return min(odd, key=lambda k: odd[k], default=statistic.plateaus[0])


def _simulated_spread(check: BeadCheck, axis: int, plateau: int) -> float:
    """Standard deviation of ln of the windows' variances, as simulated."""
    own = [
        i
        for i, one in enumerate(check.statistics)
        if (one.kind, one.axis, one.plateaus) == ("variance_spread", AXES[axis], (plateau,))
    ]
    return float(np.median(check.simulated[:, own[0]]))


def _halves_pN(
    case: PreparedBead, plateau: int
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    halves = None if case.fit.model.experiment.magnets.courses else halves_of(case)
    if halves is None:
        return None
    found = []
    for half in halves:
        try:
            fit = fit_configured(half.of(case.fit.model), case.fit.theta)
        except (FitError, ValueError):
            return None
        found.append((float(fit.force_pN[plateau]), float(fit.force_stderr_pN[plateau])))
    return found[0], found[1]
