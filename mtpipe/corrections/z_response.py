"""A look-up table of heights that is bent within the bead's own motion (PHYSICS E28).

What is recorded along z is u + c(u² − σ²) of the height u about its mean. Two things show it. The
skewness is 6cσ more than simulations have. And what is fast is recorded larger where the bead is
high, or where it is low, as the slope of the table is 1 + 2cu: a tether's own skewness hardly does
that, and noise, drift and outliers do not. In plateaus that show both the bend is undone, and the
rest is fitted again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, stats

from mtpipe.corrections.correction import Correction, Strength
from mtpipe.corrections.retraced import with_positions
from mtpipe.crosschecking.check import CLEARLY_NOT, BeadCheck, p_value_but_moments
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.crosschecking.twin import TwinMaker
from mtpipe.effects.z_response import EFFECT
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray

NAME = EFFECT.name
# Simulations without a bend: means and spreads of both signs are known to a fifth.
SIMULATIONS = 24
# Of both signs, in any plateau: the skewness tells that there is something, the growth what it is.
SKEWED_P, GROWS_P = 1e-4, 1e-2
# Fast and slow are parted by means over one of these numbers of frames: where each has half of the
# power, or nearly, both are known best.
WINDOWS = tuple(4**k for k in range(1, 6))
# Largest change of the slope within two standard deviations: from 1 on two heights read alike.
LARGEST = 0.9
ROUNDS = 40


@dataclass(frozen=True, eq=False)
class Bend:
    """The bend in one plateau.

    Attributes
    ----------
    plateau : its index. spread_nm : σ of the recorded z. slope : 2cσ, by how much the table's slope
        changes over one standard deviation, and its standard error. p_value : of the more certain
        of both signs, of all plateaus.
    """

    plateau: int
    spread_nm: float
    slope: float
    stderr: float
    p_value: float


def find(check: BeadCheck, random: np.random.Generator) -> Correction | None:
    """The bends, undone; None where no plateau has one, or simulations differ in more than that: a
    tether that is softer than simulated is more skewed too.

    Parameters
    ----------
    check : with all other effects. random : of the simulations.
    """
    if p_value_but_moments(check) < CLEARLY_NOT:
        return None
    seen = _seen(check.case, random)
    if not seen:
        return None
    positions = [position.copy() for position in check.case.positions_nm]
    for one in seen:
        z_nm = positions[one.plateau][:, 2]
        positions[one.plateau][:, 2] = unbent(z_nm, one.slope / (2 * one.spread_nm))
    try:
        corrected = with_positions(check.case, tuple(positions))
    except FitError:
        return None
    most = max(seen, key=lambda one: abs(one.slope) / one.stderr)
    where = ", ".join(str(check.case.plateaus[one.plateau].number) for one in seen)
    cause = (
        f"the look-up table's answer to height is bent within the bead's own motion: its slope is "
        f"{100 * abs(most.slope):.0f} % {'larger' if most.slope > 0 else 'smaller'} one standard "
        f"deviation ({most.spread_nm:.0f} nm) above the mean height (plateau{'s' * (len(seen) > 1)}"
        f" {where})"
    )
    strength = Strength("slope_error", abs(most.slope), most.stderr, "")
    chance_p = min(one.p_value for one in seen)
    return Correction(NAME, corrected, (strength,), cause, chance_p)


def signs(z_nm: FloatArray) -> tuple[float, float]:
    """Skewness of heights, and by how much the power of their fast part grows over one standard
    deviation of the slow one, relative to the whole.

    Parameters
    ----------
    z_nm : (n,) NaN where lost.
    """
    u = np.nan_to_num(z_nm - np.nanmean(z_nm))
    parted = [ndimage.uniform_filter1d(u, window) for window in WINDOWS]
    slow = min(parted, key=lambda one: abs(float(one.var()) / float(u.var()) - 0.5))
    power = (u - slow) ** 2
    growth = np.mean((power / power.mean() - 1) * (slow - slow.mean())) / slow.std()
    return float(stats.skew(u)), float(growth)


def unbent(z_nm: FloatArray, curvature_per_nm: float) -> FloatArray:
    """(n,) heights u of which u + c(u² − σ²), about their mean, was recorded.

    Parameters
    ----------
    z_nm : (n,) NaN where lost. curvature_per_nm : c.
    """
    mean = float(np.nanmean(z_nm))
    recorded = z_nm - mean
    # beyond this height the bend would read two heights alike
    most = LARGEST / (2 * abs(curvature_per_nm)) if curvature_per_nm else math.inf
    u = recorded
    for _ in range(ROUNDS):
        inside = np.clip(u, -most, most)
        offset = curvature_per_nm * (inside**2 - np.nanmean(inside**2))
        slope = 1 + 2 * curvature_per_nm * inside
        u = u - (u + offset - recorded) / slope
    return np.asarray(mean + u - np.nanmean(u))


def _seen(case: PreparedBead, random: np.random.Generator) -> list[Bend]:
    """The bends that both signs show, beside simulations without one."""
    maker = TwinMaker(case)
    twins = (maker.draw(random).positions_nm for _ in range(SIMULATIONS))
    simulated = np.array([[signs(position[:, 2]) for position in twin] for twin in twins])
    recorded = np.array([signs(position[:, 2]) for position in case.positions_nm])
    more, error = recorded - simulated.mean(axis=0), simulated.std(axis=0, ddof=1)
    # both of one sign
    score = more * np.sign(more[:, :1]) / error
    p_value = len(recorded) * stats.t.sf(score, SIMULATIONS - 1)
    return [
        Bend(i, float(np.nanstd(position[:, 2])), more[i, 0] / 3, error[i, 0] / 3, min(p_value[i]))
        for i, position in enumerate(case.positions_nm)
        if p_value[i, 0] < SKEWED_P and p_value[i, 1] < GROWS_P
    ]
