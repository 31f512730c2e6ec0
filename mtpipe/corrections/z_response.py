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
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from mtpipe.corrections.correction import Correction, Strength
from mtpipe.corrections.retraced import with_positions
from mtpipe.crosschecking.check import CLEARLY_NOT, BeadCheck, p_value_but_moments
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.crosschecking.twin import TwinMaker
from mtpipe.effects.z_response import EFFECT
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera, following

NAME = EFFECT.name
# Simulations without a curve, and as many with it: means and spreads are known to a fifth.
SIMULATIONS = 24
# Shares of the heights below each point of the curve: outside, few frames say how it goes on.
SHARES = np.linspace(0.02, 0.98, 13)
# p-values of the distribution and of how fast motion depends on height: of each, and of both.
EACH_P, BOTH_P = 1e-2, 1e-5
# With the curve of the distribution, half or less is left of how fast motion depends on height.
LEFT_WITH_IT = 0.5
# Relaxation times, in frames, among which that of the heights is found.
RELAXATION_FRAMES = np.geomspace(0.05, 1000.0, 400)
# Heights of a tether that is softer at some of them: number of frames, farthest from the mean and
# width over which the bumps of the density of noisy quantiles are smoothed (standard deviations),
# longest step (relaxation times), fewest steps of a frame.
FRAMES, FARTHEST, SMOOTH, LARGEST_STEP, FEWEST_STEPS = 4000, 5.0, 0.25, 0.05, 10


@dataclass(frozen=True, eq=False)
class Curve:
    """What a table makes of heights about their mean, both in standard deviations of z.

    Attributes
    ----------
    heights, recorded : (13,) increasing.
    """

    heights: FloatArray
    recorded: FloatArray

    def answered(self, heights: FloatArray) -> FloatArray:
        """What is recorded of heights."""
        return _through(self.heights, self.recorded, heights)

    def undone(self, recorded: FloatArray) -> FloatArray:
        """Heights of which this was recorded."""
        return _through(self.recorded, self.heights, recorded)


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
        standard error.
    """

    plateau: int
    curve: Curve
    slope: float
    stderr: float
    p_value: float
    in_steps: tuple[float, float]
    of_softness: tuple[float, float]

    @property
    def told_apart(self) -> bool:
        """Whether steps show more than a tether's softness would, and rather all of it."""
        (share, stderr), (softness, its_stderr) = self.in_steps, self.of_softness
        more = stats.norm.sf((share - softness) / math.hypot(stderr, its_stderr)) < EACH_P
        return bool(more and share > (1 + softness) / 2)


def find(check: BeadCheck, random: np.random.Generator) -> Correction | None:
    """The curves, undone; None where no plateau has one.

    Parameters
    ----------
    check : with all other effects. random : of the simulations.
    """
    # where more objects than skewness and kurtosis, a tether that is softer than simulated may be
    # what curves the distribution
    clear = p_value_but_moments(check) >= CLEARLY_NOT
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
    return Correction("gain_by_height_z", corrected, (spread,), cause, form="gain", axes=("z",))


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
        z = _standardised(position[:, 2])
        simulated = [_standardised(twin[i][:, 2]) for twin in twins]
        each = np.array([np.nanquantile(one, SHARES) for one in simulated])
        curve = Curve(each.mean(axis=0), np.nanquantile(z, SHARES))
        if not (np.diff(curve.recorded) > 0).all():
            continue  # heights are read in coarse steps
        curved = [_standardised(curve.answered(one)) for one in simulated]
        fast = _fast_by_height(z)
        straight, foretold = (
            np.array([_fast_by_height(one) for one in some]) for some in (simulated, curved)
        )
        both = _odd_p(curve.recorded, each), _odd_p(fast, straight)
        p_value = len(case.positions_nm) * float(stats.combine_pvalues(both).pvalue)
        certain = np.max(both) < EACH_P and p_value < BOTH_P
        # levels between which the bead jumps make other steps than the curve would
        if not (certain and _far(fast, foretold) < LEFT_WITH_IT * _far(fast, straight)):
            continue
        # points of a straight one scatter too
        own = np.array([_slope_spread(Curve(curve.heights, one)) for one in each])
        slope = math.sqrt(max(_slope_spread(curve) ** 2 - np.mean(own**2), 0.0))
        stderr = float(np.std(own, ddof=1))
        softness = _of_softness(curve, z, case.fit.model.experiment.camera, random)
        in_steps = _share(fast, straight, foretold)
        seen.append(PlateauCurve(i, curve, slope, stderr, p_value, in_steps, softness))
    return seen


def _share(fast: FloatArray, straight: FloatArray, foretold: FloatArray) -> tuple[float, float]:
    """How far numbers (m,) are from those of simulations without a curve to those with it: 0 to 1;
    and the standard error.

    Parameters
    ----------
    straight, foretold : (simulations, m).
    """
    way = foretold.mean(axis=0) - straight.mean(axis=0)
    weight = way / straight.var(axis=0, ddof=1)
    shares = [float((one - straight.mean(axis=0)) @ weight / (way @ weight)) for one in straight]
    share = float((fast - straight.mean(axis=0)) @ weight / (way @ weight))
    return share, float(np.std(shares, ddof=1))


def _of_softness(curve: Curve, z: FloatArray, camera: Camera, random: np.random.Generator) -> float:
    """How much of what a curve of the table does to steps a tether does that is softer where the
    table would be steep, and gives the same distribution: by simulation (`tether_like`), as how far
    the bead moves within a frame depends on the form of the curve; and the standard error.
    """
    able_s = RELAXATION_FRAMES * camera.frame_s
    tau_s = float(np.interp(_following(z), following(able_s, camera), able_s))
    heights = [tether_like(None, tau_s, camera, random) for _ in range(SIMULATIONS)]
    softer = [tether_like(curve, tau_s, camera, random) for _ in range(SIMULATIONS)]
    straight = [_standardised(one) for one in heights]
    each = np.array([np.quantile(one, SHARES) for one in straight])
    of_softer = np.mean([np.quantile(_standardised(one), SHARES) for one in softer], axis=0)
    own = Curve(each.mean(axis=0), of_softer)
    share, stderr = _share(
        np.mean([_fast_by_height(_standardised(one)) for one in softer], axis=0),
        np.array([_fast_by_height(one) for one in straight]),
        np.array([_fast_by_height(own.answered(one)) for one in straight]),
    )
    return share, stderr / math.sqrt(SIMULATIONS)


def tether_like(
    curve: Curve | None, tau_s: float, camera: Camera, random: np.random.Generator
) -> FloatArray:
    """(4000,) heights that are recorded of a bead on a spring that is softer where a curve is
    steep, so that they are distributed by it; None: a spring of one stiffness.

    Parameters
    ----------
    tau_s : relaxation time of the spring of one stiffness, whose standard deviation is 1.
    """
    # numba is loaded where something is simulated only
    from mtpipe.simulation.axial_steps import averaged_heights

    at = np.linspace(-FARTHEST, FARTHEST, 401)
    ln_density = -(at**2) / 2
    if curve is not None:
        heights = curve.undone(at)
        ln_density = np.log(np.gradient(heights, at)) - heights**2 / 2
        bumps = ln_density + at**2 / 2
        ln_density = gaussian_filter1d(bumps, SMOOTH / (at[1] - at[0]), mode="nearest") - at**2 / 2
    steps = max(math.ceil(camera.frame_s / (LARGEST_STEP * tau_s)), FEWEST_STEPS)
    step = camera.frame_s / steps / tau_s
    exposed = round(steps * camera.exposure_s / camera.frame_s)
    move, spread = np.gradient(ln_density, at) * step, np.full(len(at), math.sqrt(2 * step))
    begun = random.normal()
    found, _ = averaged_heights(
        move, spread, -FARTHEST, FARTHEST, begun, FRAMES, steps, exposed, random
    )
    return found


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


def _fast_by_height(z: FloatArray) -> FloatArray:
    """(12,) ln of the root mean square step from one frame to the next, by the height at which it
    is made, about the mean over heights.

    Parameters
    ----------
    z : (n,) NaN where lost.
    """
    step, height = np.diff(z), (z[1:] + z[:-1]) / 2
    known = np.isfinite(step)
    step, height = step[known], height[known]
    edges = np.quantile(height, SHARES)
    place = np.digitize(height, edges)
    squares = np.bincount(place, step**2, minlength=len(SHARES) + 1)[1 : len(SHARES)]
    counts = np.bincount(place, minlength=len(SHARES) + 1)[1 : len(SHARES)]
    with np.errstate(divide="ignore", invalid="ignore"):  # NaN where no step is made at a height
        size = 0.5 * np.log(squares / counts)
    return np.asarray(size - size.mean())


def _following(z: FloatArray) -> float:
    """Mean square step over two frames over that over one, less 1, as `physics.camera.following`.

    Noise makes it smaller, so that less is told apart.
    """
    one, two = (float(np.nanmean((z[by:] - z[:-by]) ** 2)) for by in (1, 2))
    return two / one - 1


def _slope_spread(curve: Curve) -> float:
    """Standard deviation of a curve's slope over the heights, relative to its mean."""
    slope = np.diff(curve.recorded) / np.diff(curve.heights)
    return float(np.std(slope) / np.mean(slope))


def _standardised(z: FloatArray) -> FloatArray:
    return np.asarray((z - np.nanmean(z)) / np.nanstd(z))


def _through(x: FloatArray, y: FloatArray, values: FloatArray) -> FloatArray:
    """A smooth rising curve through points, and straight on beyond them."""
    curve = PchipInterpolator(x, y)
    inside = np.clip(values, x[0], x[-1])
    below = (y[1] - y[0]) / (x[1] - x[0]) * np.minimum(values - x[0], 0.0)
    above = (y[-1] - y[-2]) / (x[-1] - x[-2]) * np.maximum(values - x[-1], 0.0)
    return np.asarray(curve(inside) + below + above)
