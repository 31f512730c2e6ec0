"""A force that drifts smoothly within a plateau: how far, and what that does to the force given.

Heights tell such drift far better, but the stage drifts too; the size that is said comes from the
sideways motion, which only the force changes. A drift is not cut: the cross-check can name it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtpipe.recording import Plateau
from mtpipe.states.blocks import relaxation_frames
from mtpipe.states.motion import Motion, middle

# By chance one plateau in 16 000 shows a trend.
SIGMAS = 4.0
# Smaller drifts change the force that a plateau gives by less than a thousandth.
LEAST_LOG_CHANGE = 0.1
# Relative error of the force of a drifting plateau, about the variance of ln F in it (PHYSICS E23),
# from which no force is given.
MOST_BIAS = 0.05


@dataclass(frozen=True)
class Trend:
    """Drift of the force over a plateau: ln of its last over its first value, standard error."""

    plateau: Plateau
    log_change: float
    stderr: float

    @property
    def bias(self) -> float:
        """Relative error of the one force that stands for all: the variance of ln F."""
        return self.log_change**2 / 12


def force_trend(motion: Motion, plateau: Plateau) -> Trend | None:
    """Drift of the force as the sideways motion of all beads tells it; None where none is certain.

    The first third of the plateau is held against the last: their middles are two thirds apart.
    """
    third = (plateau.stop - plateau.start) // 3
    logs, weights = [], []
    for xyz in motion.position_nm.values():
        for axis in (0, 1):
            column = xyz[plateau.start : plateau.stop, axis]
            first, last = column[:third], column[len(column) - third :]
            if min(np.isfinite(first).sum(), np.isfinite(last).sum()) < third / 2 or third < 16:
                continue
            variances = float(np.nanvar(first)), float(np.nanvar(last))
            if min(variances) <= 0:
                continue
            # independent squares: one per relaxation time, the mean of an exponential's square
            slow = max(relaxation_frames(middle(column)), 1.0)
            logs.append(math.log(variances[0] / variances[1]))
            weights.append(third / slow / 4)
    if not logs:
        return None
    log = float(np.average(logs, weights=weights))
    stderr = sum(weights) ** -0.5
    # beads of their own ways tell less than they seem to
    if len(logs) > 2:
        stderr = max(stderr, float(np.std(logs, ddof=1)) / math.sqrt(len(logs)))
    whole, error = 1.5 * log, 1.5 * stderr
    if abs(whole) < max(SIGMAS * error, LEAST_LOG_CHANGE):
        return None
    return Trend(plateau, whole, error)
