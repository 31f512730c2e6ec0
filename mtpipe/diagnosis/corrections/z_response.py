"""A look-up table of heights that is curved within the bead's own motion (PHYSICS E28).

What is recorded along z is a rising function of the height, the same at all times of a plateau. Two
things show it. Heights are distributed otherwise than simulated ones. And what is fast is recorded
larger where the function is steep, just where heights are seldom: the distribution alone foretells
how fast motion depends on height. Noise, drift, outliers and hops do not do that, nor does a tether
that is softer at some heights, if frames follow each other within its relaxation time: steps show
only a part of its softness. In plateaus that show both the curve is undone, and the rest is fitted
again. Where a tether may do as much, that is told as a gain that depends on the height, and has no
name.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np
from scipy import stats

from mtpipe.crosschecking.check import CLEARLY_NOT, BeadCheck, p_value_but_moments
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.crosschecking.twin import TwinMaker
from mtpipe.diagnosis.corrections.correction import Correction, Strength
from mtpipe.diagnosis.corrections.height_curve import (
    SHARES,
    Curve,
    fast_by_height,
    share_of_way,
    standardised,
)
from mtpipe.diagnosis.corrections.retraced import with_positions
from mtpipe.diagnosis.corrections.softness import steps_of_softness
from mtpipe.effects.z_response import EFFECT
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray

NAME = EFFECT.name
# Simulations without a curve, and as many with it: means and spreads are known to a fifth.
SIMULATIONS = 24
# p-values of the distribution and of how fast motion depends on height: of each, and of both in one
# plateau at least. A table that is curved in one is likely to be in others.
EACH_P, BOTH_P = 1e-2, 1e-5
# With the curve of the distribution, half or less is left of how fast motion depends on height.
LEFT_WITH_IT = 0.5


@dataclass(frozen=True, eq=False)
class PlateauCurve:
    """The curve in one plateau.

    Attributes
    ----------
    plateau : its index. curve : of it. slope : by how much, relative to the mean, its slope differs
        over the heights (standard deviation), and the standard error. p_value : of both signs
        together (Fisher), times the number of plateaus.
    in_steps : how much of what the curve foretells of the steps they show, and the standard error.
    of_softness : how much they would if it were a tether that is softer at some heights, and the
        standard error. plateaus : in which a curve was looked for.
    """

    plateau: int
    curve: Curve
    slope: float
    stderr: float
    p_value: float
    in_steps: tuple[float, float]
    of_softness: tuple[float, float]
    plateaus: int

    @property
    def told_apart(self) -> bool:
        """Whether steps show more than a tether's softness would, and rather all of it."""
        (share, stderr), (softness, its_stderr) = self.in_steps, self.of_softness
        p_value = self.plateaus * stats.norm.sf((share - softness) / math.hypot(stderr, its_stderr))
        told = p_value < EACH_P and share > (1 + softness) / 2
        return bool(told and self.p_value < BOTH_P)


def find(check: BeadCheck, random: np.random.Generator) -> Correction | None:
    """The curves, undone; None where no plateau has one.

    Parameters
    ----------
    check : with all other effects. random : of the simulations.
    """
    # where more along z objects than skewness and kurtosis, a tether that is softer than simulated
    # may be what curves the distribution
    clear = p_value_but_moments(check, "z") >= CLEARLY_NOT
    seen = [one for one in curves(check.case, random) if clear or one.told_apart]
    if not seen:
        return None
    positions = [position.copy() for position in check.case.positions_nm]
    for one in seen:
        positions[one.plateau][:, 2] = straightened(positions[one.plateau][:, 2], one.curve)
    try:
        corrected = with_positions(check.case, tuple(positions))
    except FitError:
        return None
    most = max(seen, key=lambda one: one.slope / one.stderr)
    where = ", ".join(str(check.case.plateaus[one.plateau].number) for one in seen)
    spread_nm = float(np.nanstd(check.case.positions_nm[most.plateau][:, 2]))
    where = f"plateau{'s' * (len(seen) > 1)} {where}"
    told_apart = [one.p_value for one in seen if one.told_apart]
    if told_apart:
        cause = (
            f"the look-up table's answer to height is curved within the bead's own motion: its "
            f"slope differs by {100 * most.slope:.0f} % over heights some {spread_nm:.0f} nm apart "
            f"({where})"
        )
        strength = Strength("slope_error", most.slope, most.stderr, "")
        return Correction(NAME, corrected, (strength,), cause, min(told_apart))
    cause = (
        f"motion along z is recorded {100 * most.slope:.0f} % larger at some heights than at "
        f"others some {spread_nm:.0f} nm apart ({where}), as by a curved look-up table or by a "
        f"tether that is softer at some heights, which this recording does not tell apart"
    )
    spread = Strength("spread", most.slope, most.stderr, "")
    by_chance = min(one.p_value for one in seen)
    return Correction(
        "gain_by_height_z", corrected, (spread,), cause, by_chance, form="gain", axes=("z",)
    )


def straightened(z_nm: FloatArray, curve: Curve) -> FloatArray:
    """Heights of which z was recorded, in units of which z has a mean slope of 1.

    Parameters
    ----------
    z_nm : (n,) NaN where lost.

    Returns
    -------
    (n,) nm.
    """
    mean, spread = float(np.nanmean(z_nm)), float(np.nanstd(z_nm))
    recorded = (z_nm - mean) / spread
    heights = curve.undone(recorded)
    heights -= np.nanmean(heights)
    # how large the mean slope of the table is, the curve does not tell: that is a scale's to say
    slope = np.nanmean(recorded * heights) / np.nanmean(heights**2)
    return np.asarray(mean + spread * slope * heights)


def curves(case: PreparedBead, random: np.random.Generator) -> list[PlateauCurve]:
    """The curves that distribution and fast motion both show.

    Parameters
    ----------
    case : with the fit of all other effects. random : of the simulations.
    """
    maker = TwinMaker(case)
    twins = [maker.draw(random).positions_nm for _ in range(SIMULATIONS)]
    seen = []
    for i, position in enumerate(case.positions_nm):
        z = standardised(position[:, 2])
        simulated = [standardised(twin[i][:, 2]) for twin in twins]
        each = np.array([np.nanquantile(one, SHARES) for one in simulated])
        curve = Curve(each.mean(axis=0), np.nanquantile(z, SHARES))
        if not (np.diff(curve.recorded) > 0).all():
            continue  # heights are read in coarse steps
        curved = [standardised(curve.answered(one)) for one in simulated]
        fast = fast_by_height(z)
        straight, foretold = (
            np.array([fast_by_height(one) for one in some]) for some in (simulated, curved)
        )
        both = _odd_p(curve.recorded, each), _odd_p(fast, straight)
        p_value = len(case.positions_nm) * float(stats.combine_pvalues(both).pvalue)
        # levels between which the bead jumps make other steps than the curve would
        foreseen = _far(fast, foretold) < LEFT_WITH_IT * _far(fast, straight)
        if not (np.max(both) < EACH_P and foreseen):  # nor where a height has no step (NaN)
            continue
        # points of a straight one scatter too
        own = np.array([_slope_spread(Curve(curve.heights, one)) for one in each])
        slope = math.sqrt(max(_slope_spread(curve) ** 2 - np.mean(own**2), 0.0))
        stderr = float(np.std(own, ddof=1))
        softness = steps_of_softness(curve, z, case.fit.model.experiment.camera, random)
        in_steps = share_of_way(fast, straight, foretold)
        number = len(case.positions_nm)
        seen.append(PlateauCurve(i, curve, slope, stderr, p_value, in_steps, softness, number))
    return seen if any(one.p_value < BOTH_P for one in seen) else []


def _odd_p(recorded: FloatArray, simulated: FloatArray) -> float:
    """p-value of how far numbers are from those of simulations.

    Parameters
    ----------
    recorded : (m,). simulated : (simulations, m).
    """
    own = np.array([_far(one, simulated) for one in simulated])
    # neighbouring numbers go together: a gamma law of the same mean and variance
    mean, variance = own.mean(), own.var(ddof=1)
    p_value = stats.gamma.sf(_far(recorded, simulated), mean**2 / variance, scale=variance / mean)
    return max(float(p_value), sys.float_info.min)


def _far(one: FloatArray, simulated: FloatArray) -> float:
    """Sum of squared differences from the means of simulations, in their standard deviations."""
    spread = simulated.std(axis=0, ddof=1)
    return float(np.sum(((one - simulated.mean(axis=0)) / spread) ** 2))


def _slope_spread(curve: Curve) -> float:
    """Standard deviation of a curve's slope over the heights, relative to its mean."""
    slope = np.diff(curve.recorded) / np.diff(curve.heights)
    return float(np.std(slope) / np.mean(slope))
