"""What is known of a bead's friction before a trace is fitted: from the setup, or from the bead.

Friction over the friction expected from radius, viscosity and height is one number per bead and
axis. Where the free fits of all plateaus agree with one, the setup is believed; where they
contradict it, the other plateaus of the same axis are. Beads recorded together share the buffer:
what is uncertain of its viscosity, the other beads tell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtpipe.ground.estimate import Estimate

# Beyond this many standard errors the setup's friction is contradicted.
CONTRADICTION_SIGMAS = 4.0


@dataclass(frozen=True)
class MeasuredFriction:
    """What one free fit says of the bead's friction: ln of measured over expected."""

    plateau: int
    axis: int
    ln_ratio: float
    stderr: float


@dataclass(frozen=True)
class FrictionPrior:
    """Prior knowledge of friction, from the setup or from the bead's other plateaus."""

    measured: tuple[MeasuredFriction, ...]
    allowance: float

    def contradicted(self, axis: int) -> bool:
        """Whether the free fits contradict the setup on this axis (z: on x or on y)."""
        if axis == 2:
            return self.contradicted(0) or self.contradicted(1)
        overall = _combined([m for m in self.measured if m.axis == axis])
        return overall is not None and abs(overall[0]) > CONTRADICTION_SIGMAS * math.hypot(
            overall[1], self.allowance
        )

    def prior(self, nominal: float, plateau: int, axis: int) -> tuple[float, float] | None:
        """Friction and standard error for a trace; None where nothing is known."""
        if not self.contradicted(axis):
            return nominal, nominal * self.allowance
        # without the trace itself, whose friction is in its likelihood already
        others = _combined(
            [m for m in self.measured if axis == 2 or (m.axis == axis and m.plateau != plateau)]
        )
        if others is None:
            return None
        centre = nominal * math.exp(others[0])
        return centre, centre * math.hypot(others[1], self.allowance)


def ratio_estimate(measured: Sequence[MeasuredFriction]) -> Estimate | None:
    """Friction over expected friction of a bead, all plateaus and both lateral axes together."""
    overall = _combined(measured)
    if overall is None:
        return None
    value, sigma = math.exp(overall[0]), overall[1]
    interval = (value * math.exp(-sigma), value * math.exp(sigma))
    return Estimate(value, value * sigma, interval, "", "free fits of all plateaus")


def viscosity_from_others(
    viscosity_mPa_s: tuple[float, float],
    others: Sequence[Estimate],
    apart_from_viscosity: float,
) -> tuple[float, float]:
    """The buffer's viscosity and its standard error, given what other beads' friction says of it.

    Parameters
    ----------
    viscosity_mPa_s : as the setup states it, value and standard error.
    others : friction over expected friction of the other beads.
    apart_from_viscosity : relative standard error of a bead's expected friction from all else
        (its radius first), which each bead has anew.

    Gaussian in the logarithms. Beads that contradict the stated viscosity have another fault and
    are not asked.
    """
    value, stderr = viscosity_mPa_s
    if not stderr > 0:
        return viscosity_mPa_s
    prior = (stderr / value) ** 2
    precision, sum_of_logs = 1 / prior, 0.0
    for ratio in others:
        variance = (ratio.stderr / ratio.value) ** 2 + apart_from_viscosity**2
        if abs(math.log(ratio.value)) < CONTRADICTION_SIGMAS * math.sqrt(prior + variance):
            precision += 1 / variance
            sum_of_logs += math.log(ratio.value) / variance
    better = value * math.exp(sum_of_logs / precision)
    return better, better / math.sqrt(precision)


def _combined(values: Sequence[MeasuredFriction]) -> tuple[float, float] | None:
    """Weighted mean and standard error, widened where the values scatter more than stated."""
    if not values:
        return None
    ln_ratio = np.array([value.ln_ratio for value in values])
    weight = np.array([value.stderr for value in values]) ** -2.0
    mean = float(weight @ ln_ratio / weight.sum())
    error = 1 / math.sqrt(weight.sum())
    if len(values) > 1:
        chi2 = float(weight @ (ln_ratio - mean) ** 2) / (len(values) - 1)
        error *= math.sqrt(max(1.0, chi2))
    return mean, error
