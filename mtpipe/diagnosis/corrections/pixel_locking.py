"""A tracker whose response has the period of the camera's pixels (PHYSICS E21).

What is recorded along x and y is u + a sin(2πu/p) + b cos(2πu/p) of the place u on the camera, bead
and stage together. Both the places where a bead is found and how far it seems to move from one
frame to the next then depend on the place within the pixel. For a first-order Gaussian
autoregression seen through such a response the derivative of the likelihood by a and b vanishes on
average without a response, whatever the spectrum (Stein 1981, lemma 1), so it serves as a test; its
variance is that of its sums over blocks of frames, and what mean, variance and correlation of every
plateau could explain is taken out of it. The response is undone and the rest is fitted again.

Traces are no autoregressions: lines, knocks or rounded positions raise the test's χ². They raise it
at every period, so the same test at periods that no pixel has, on the traces with the response
undone, says what χ² means.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, stats

from mtpipe.crosschecking.check import BeadCheck
from mtpipe.diagnosis.corrections.correction import Correction, Strength
from mtpipe.diagnosis.corrections.retraced import with_positions
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray

REMEDY = "check the tracker with an immobile bead on a moving stage."

NAME = "pixel_locking"
# Periods that are tried where the setup states no pixel.
SHORTEST_NM, LONGEST_NM = 40.0, 400.0
# Least spread of a trace with which a period can be seen: 2π spread/period, in radians.
LEAST_WIDTH = 0.7
# Step of 1/period in the search, over 1/spread of all positions, which is what they resolve.
FINENESS = 0.08
NEEDED_P = 1e-4
# Periods over that of the response at which nothing is expected: neither its own, as far as it is
# resolved, nor its harmonics.
ELSEWHERE = (*np.linspace(0.55, 0.8, 9), *np.linspace(1.25, 2.4, 12))
BLOCK_FRAMES = 256
# Largest slope of the periodic error, nm per nm: from 1 on two places would give one position.
LARGEST_SLOPE = 0.9
ROUNDS, UNDOING = 8, 40


@dataclass(frozen=True, eq=False)
class Trace:
    """One axis in one plateau: `raw_nm` (n,) on the camera, NaN where lost, and what of it is the
    stage, `stage_nm` (n,).
    """

    raw_nm: FloatArray
    stage_nm: FloatArray

    @functools.cached_property
    def spread_nm(self) -> float:
        """Standard deviation of the bead itself."""
        return float(np.nanstd(self.raw_nm - self.stage_nm))


@dataclass(frozen=True, eq=False)
class Score:
    """Derivative of ln likelihood by a and b, (2,), its variance, and the information, (2, 2)."""

    slope: FloatArray
    variance: FloatArray
    information: FloatArray

    @property
    def gain(self) -> float:
        """ln likelihood that the best response would add, in nats, to second order."""
        return 0.5 * float(self.slope @ np.linalg.solve(self.information, self.slope))

    @property
    def chi2(self) -> float:
        """χ² with two degrees of freedom if there is no response."""
        return float(self.slope @ np.linalg.solve(self.variance, self.slope))


@dataclass(frozen=True, eq=False)
class Response:
    """A response of one axis: a and b, (2,) nm, and their covariance."""

    size_nm: FloatArray
    covariance: FloatArray

    @property
    def amplitude_nm(self) -> float:
        """Amplitude of the sine."""
        return float(np.hypot(*self.size_nm))

    @property
    def stderr_nm(self) -> float:
        """Standard error of the amplitude."""
        along = self.size_nm / max(self.amplitude_nm, 1e-12)
        return math.sqrt(float(along @ self.covariance @ along))


@dataclass(frozen=True)
class Period:
    """A period in nm, and χ² of a response with it; `tried` : how many periods were."""

    nm: float
    stderr_nm: float
    chi2: float
    freedom: int
    tried: int

    def p_value(self, usual: float) -> float:
        """Of the response, where χ² without one is `usual` times that of an autoregression."""
        return min(1.0, self.tried * float(stats.chi2.sf(self.chi2 / usual, self.freedom)))


def find(check: BeadCheck) -> Correction | None:
    """The response, undone; None where there is none."""
    case = check.case
    axes = [
        [
            Trace(position[:, axis] + stage[:, axis], stage[:, axis])
            for position, stage in zip(case.positions_nm, case.camera_offset_nm, strict=True)
        ]
        for axis in (0, 1)
    ]
    seen = period(axes, case.pixel_nm)
    if seen.p_value(1.0) > NEEDED_P:
        return None
    period_nm = seen.nm
    responses = [fitted(traces, period_nm) for traces in axes]
    cleaned = [
        [replace(trace, raw_nm=undone(trace.raw_nm, response.size_nm, period_nm)) for trace in axis]
        for axis, response in zip(axes, responses, strict=True)
    ]
    p_value = seen.p_value(usual_chi2(cleaned, period_nm))
    if p_value > NEEDED_P:
        return None
    positions = []
    for i, position in enumerate(case.positions_nm):
        place = position.copy()
        for axis, traces in enumerate(cleaned):
            place[:, axis] = traces[i].raw_nm - traces[i].stage_nm
        positions.append(place)
    try:
        corrected = with_positions(case, tuple(positions))
    except FitError:
        return None
    along_x, along_y = responses
    strengths = (
        Strength("amplitude in x", along_x.amplitude_nm, along_x.stderr_nm, "nm"),
        Strength("amplitude in y", along_y.amplitude_nm, along_y.stderr_nm, "nm"),
        Strength("period", period_nm, seen.stderr_nm, "nm"),
    )
    origin = "the pixel" if case.pixel_nm else "found here; the setup states no pixel"
    cause = (
        f"the tracker's response oscillates by {along_x.amplitude_nm:.2g} nm in x and "
        f"{along_y.amplitude_nm:.2g} nm in y with a period of {period_nm:.4g} nm ({origin})"
    )
    return Correction(NAME, corrected, strengths, cause, p_value)


def period(axes: Sequence[Sequence[Trace]], stated_nm: float | None) -> Period:
    """Period of a response common to several axes.

    Parameters
    ----------
    axes : per axis, its traces. stated_nm : None: every period is tried, and counted as a look.
    """
    none = np.zeros(2)

    def scores(inverse: float) -> list[Score]:
        return [score(traces, 1 / inverse, none) for traces in axes]

    def gain(inverse: float) -> float:
        return sum(one.gain for one in scores(inverse))

    if stated_nm is not None:
        return Period(stated_nm, 0.0, _chi2(axes, stated_nm), 2 * len(axes), 1)
    spread = max(
        float(np.nanstd(np.concatenate([trace.raw_nm for trace in traces]))) for traces in axes
    )
    step = FINENESS / spread
    widest = min(max(trace.spread_nm for trace in traces) for traces in axes)
    lowest = max(1 / LONGEST_NM, LEAST_WIDTH / (2 * np.pi * widest))
    highest = max(1 / SHORTEST_NM, lowest)
    tried = math.ceil((highest - lowest) / step)
    grid = np.linspace(lowest, highest, tried + 1)
    best = float(grid[int(np.argmax([gain(inverse) for inverse in grid]))])
    bounds = (max(best - step, lowest), best + step)
    found = optimize.minimize_scalar(
        lambda inverse: -gain(inverse), bounds=bounds, method="bounded"
    )
    at, aside = float(found.x), 0.1 * step
    curvature = (2 * gain(at) - gain(at - aside) - gain(at + aside)) / aside**2
    stderr = 1 / math.sqrt(curvature) if curvature > 0 else step
    return Period(1 / at, stderr / at**2, _chi2(axes, 1 / at), 2 * len(axes), len(grid))


def usual_chi2(axes: Sequence[Sequence[Trace]], period_nm: float) -> float:
    """χ² of traces without a response over what it would be for an autoregression, no less than 1:
    the median over periods that are not this one.
    """
    elsewhere = [_chi2(axes, period_nm * ratio) for ratio in ELSEWHERE]
    return max(1.0, float(np.median(elsewhere) / stats.chi2.median(2 * len(axes))))


def _chi2(axes: Sequence[Sequence[Trace]], period_nm: float) -> float:
    return sum(score(traces, period_nm, np.zeros(2)).chi2 for traces in axes)


def fitted(traces: Sequence[Trace], period_nm: float) -> Response:
    """The response at which the score vanishes, by Newton's method."""
    size = np.zeros(2)
    for _ in range(ROUNDS):
        here = score(traces, period_nm, size)
        step = np.linalg.solve(here.information, here.slope)
        size = size + step
        steepest = 2 * np.pi / period_nm * float(np.hypot(*size))
        size = size * min(1.0, LARGEST_SLOPE / max(steepest, 1e-12))
        if float(np.hypot(*step)) < 1e-3:
            break
    inverse = np.linalg.inv(here.information)
    return Response(size, inverse @ here.variance @ inverse)


def undone(raw_nm: FloatArray, size_nm: FloatArray, period_nm: float) -> FloatArray:
    """(n,) places on the camera that a response shows as these."""
    q = 2 * np.pi / period_nm
    place = raw_nm
    if not size_nm.any():
        return place
    for _ in range(UNDOING):
        place = raw_nm - size_nm[0] * np.sin(q * place) - size_nm[1] * np.cos(q * place)
    return np.asarray(place)


def score(traces: Sequence[Trace], period_nm: float, size_nm: FloatArray) -> Score:
    """Derivative of ln likelihood by a further response, one of this size being undone."""
    slope, variance, information = np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2))
    width = LEAST_WIDTH * period_nm / (2 * np.pi)
    for trace in [trace for trace in traces if trace.spread_nm >= width] or traces:
        each = _per_frame(trace, period_nm, size_nm)
        slope += each.sum(axis=1)
        information += each @ each.T
        edges = np.arange(0, each.shape[1], BLOCK_FRAMES)
        blocks = np.add.reduceat(each, edges, axis=1)
        variance += blocks @ blocks.T
    return Score(slope, variance, information)


def _per_frame(trace: Trace, period_nm: float, size_nm: FloatArray) -> FloatArray:
    """(2, pairs) each frame's part of the score, without what mean, variance and correlation of
    this trace could explain.
    """
    q = 2 * np.pi / period_nm
    place = undone(trace.raw_nm, size_nm, period_nm)
    deviation = place - trace.stage_nm
    deviation = deviation - np.nanmean(deviation)
    known = np.isfinite(deviation[1:] * deviation[:-1])
    now, before = deviation[1:][known], deviation[:-1][known]
    variance = float(np.mean(now**2))
    ratio = float(np.mean(now * before)) / variance
    kick = variance * (1 - ratio**2)
    innovation = (now - ratio * before) / kick
    sine, cosine = np.sin(q * place), np.cos(q * place)
    waves = np.array([sine, cosine])
    later, earlier = waves[:, 1:][:, known], waves[:, :-1][:, known]
    steepness = q * np.array([later[1], -later[0]])
    wanted = innovation * (later - ratio * earlier) - steepness
    others = np.array(
        [
            innovation * (1 - ratio),
            innovation * before,
            (innovation**2 * kick - 1) / (2 * kick),
        ]
    )
    others = others - others.mean(axis=1, keepdims=True)
    shares = np.linalg.solve(others @ others.T, others @ wanted.T)
    return np.asarray(wanted - shares.T @ others)
