"""A force that drifts smoothly within a plateau: how far, and what that does to the force given.

Heights tell such drift far better, but the stage drifts too; the size that is said comes from the
sideways motion, which only the force changes. A drift is not cut: the cross-check can name it.
"""

from __future__ import annotations

from dataclasses import dataclass

from mtpipe.recording.recording import Plateau
from mtpipe.states.motion import Motion
from mtpipe.states.size import force_change

# Standard errors from which a trend is seen: by chance in one of 16 000 plateaus.
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
    first = slice(plateau.start, plateau.start + third)
    last = slice(plateau.stop - third, plateau.stop)
    log, stderr = force_change(motion, first, last)
    whole, error = 1.5 * log, 1.5 * stderr
    if not abs(whole) > max(SIGMAS * error, LEAST_LOG_CHANGE):
        return None
    return Trend(plateau, whole, error)
