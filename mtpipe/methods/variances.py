"""Equipartition, Allan variance and Hadamard variance: which statistics each of them takes.

All three are fitted alike (`quasi_likelihood`); they differ in what they look at. The Allan
variance takes overlapping means of 1, 2, 4, … frames (Lansdorp & Saleh 2012, and its erratum); the
Hadamard variance their second differences, which a linear drift leaves alone (Pritzl et al. 2024).
Equipartition takes the variance. Blur needs the relaxation time as well: with a given friction the
variance alone decides (Wong & Halvorsen 2006); without, the mean square step from frame to frame
comes on top, which is sharp for slow motion and, by the share of an exposure that successive frames
have in common, still tells a relaxation time much shorter than a frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mtpipe.fit.arguments import TraceArguments
from mtpipe.ground.types import FloatArray
from mtpipe.methods.motion import SeenMotion
from mtpipe.methods.quadratic import Gaps, QuadraticStatistics, Stencil, statistics_of
from mtpipe.methods.quasi_likelihood import fit_statistics
from mtpipe.methods.result import MethodFit

# Where the noise is fitted too, lags up to this many relaxation times tell it from the motion.
LONGEST_LAG = 2.0


def fit_equipartition(method: str, arguments: TraceArguments) -> MethodFit:
    """Variance, with as many structure functions as there are other unknowns."""
    start = _start(arguments)
    noise_known = arguments.noise_variance_nm2 is not None
    alone = noise_known and arguments.friction is not None
    lags: tuple[int, ...] = () if alone else (1,)
    if not noise_known:
        tau_frames = math.exp(start[1] - start[0]) / arguments.camera.frame_s
        longest = min(LONGEST_LAG * tau_frames, len(arguments.x_nm) / 8)
        lags = _octaves(max(2, int(longest)))
    statistics = equipartition_statistics(arguments.x_nm, lags)
    return fit_statistics(
        method, statistics, arguments, start, friction_is_given=alone, notes=_gaps(statistics)
    )


def fit_allan(method: str, arguments: TraceArguments) -> MethodFit:
    """Allan variance of overlapping means, in octaves up to half the trace."""
    statistics = allan_statistics(arguments.x_nm)
    return fit_statistics(method, statistics, arguments, _start(arguments), notes=_gaps(statistics))


def fit_hadamard(method: str, arguments: TraceArguments) -> MethodFit:
    """Hadamard variance of overlapping means, in octaves up to half the trace."""
    statistics = hadamard_statistics(arguments.x_nm)
    return fit_statistics(method, statistics, arguments, _start(arguments), notes=_gaps(statistics))


def equipartition_statistics(x_nm: FloatArray, lags: tuple[int, ...]) -> QuadraticStatistics:
    """Variance about the mean, and ⟨(x_{t+l} − x_t)²⟩ for each lag; its expectation is 2c₀ − 2c_l.

    What subtracting the mean takes from the variance is part of its expectation.
    """
    variance_of_mean = _variance_of_mean(np.isfinite(x_nm))

    def expected(motion: SeenMotion) -> FloatArray:
        zero = motion.lag_covariance(0)
        steps = 2 * (zero - motion.lag_covariance(np.array(lags)))
        return np.append(zero - variance_of_mean(motion), steps)

    stencils = (Stencil((0,), (1.0,)), *(Stencil((0, lag), (-1.0, 1.0)) for lag in lags))
    return statistics_of(x_nm, stencils, expected, on_sums=False)


def allan_statistics(x_nm: FloatArray) -> QuadraticStatistics:
    """½⟨(x̄_{j+m} − x̄_j)²⟩ over all j, for m = 1, 2, 4, … up to a quarter of the trace."""
    sizes = _octaves(len(x_nm) // 4)
    stencils = tuple(
        Stencil((0, m, 2 * m), _scaled((1.0, -2.0, 1.0), math.sqrt(2) * m)) for m in sizes
    )
    return statistics_of(
        x_nm, stencils, lambda motion: motion.allan_variance(np.array(sizes)), on_sums=True
    )


def hadamard_statistics(x_nm: FloatArray) -> QuadraticStatistics:
    """⅙⟨(x̄_{j+2m} − 2x̄_{j+m} + x̄_j)²⟩ over all j, for m = 1, 2, 4, … up to a sixth of the trace."""
    sizes = _octaves(len(x_nm) // 6)
    stencils = tuple(
        Stencil((0, m, 2 * m, 3 * m), _scaled((-1.0, 3.0, -3.0, 1.0), math.sqrt(6) * m))
        for m in sizes
    )
    return statistics_of(
        x_nm, stencils, lambda motion: motion.hadamard_variance(np.array(sizes)), on_sums=True
    )


def _octaves(largest: int) -> tuple[int, ...]:
    """1, 2, 4, … up to the largest."""
    return tuple(1 << power for power in range(largest.bit_length()))


def _scaled(coefficients: tuple[float, ...], divisor: float) -> tuple[float, ...]:
    return tuple(coefficient / divisor for coefficient in coefficients)


def _start(arguments: TraceArguments) -> FloatArray:
    """Rough (ln k, ln γ, ε²): the best of a grid of relaxation times, to the Allan variance.

    The scale is profiled: for a given shape it is the weighted mean of measured over shape. The
    result of a fit does not depend on the start; that there always is one matters.
    """
    statistics = allan_statistics(arguments.x_nm)
    frame_s, known = arguments.camera.frame_s, arguments.noise_variance_nm2
    sizes = np.array([stencil.spacing for stencil in statistics.stencils])
    weight = 1 / (sizes * np.sum(1 / sizes))
    values = np.maximum(statistics.values, 1e-9 * statistics.values.max())
    if known is not None:
        values = values - np.minimum(known / sizes, 0.9 * values)
    best, chosen = math.inf, np.zeros(3)
    for tau in np.geomspace(0.02 * frame_s, len(arguments.x_nm) * frame_s, 25):
        shape = statistics.expected(SeenMotion(1.0, tau, arguments.camera))
        for white in (0.0,) if known is not None else (0.0, 0.02, 0.1, 0.3, 0.6):
            mixed = (1 - white) * shape + white / sizes
            ratio = values / mixed
            scale = float(weight @ ratio)
            # Gamma laws with as many degrees of freedom as there are windows side by side
            loss = len(arguments.x_nm) * float(weight @ (np.log(mixed * scale) + ratio / scale))
            ln_stiffness = math.log(arguments.thermal_energy_pN_nm / ((1 - white) * scale))
            ln_friction = ln_stiffness + math.log(tau)
            if arguments.friction is not None:
                value, stderr = arguments.friction
                away = ln_friction - math.log(value)
                loss += away**2 / ((stderr / value) ** 2 + 0.01)
            if loss < best:
                best, chosen = loss, np.array([ln_stiffness, ln_friction, white * scale])
    return chosen


def _variance_of_mean(present: NDArray[np.bool_]) -> Callable[[SeenMotion], float]:
    """What subtracting the mean of the frames present takes from their variance, for a motion."""
    n = int(present.sum())
    if n == len(present):
        return lambda motion: float(motion.mean_variance(n))
    pairs = Gaps(present, (), on_sums=False).pairs
    lags = np.arange(len(present))
    counts = np.where(lags == 0, 1.0, 2.0) * pairs / n**2
    return lambda motion: float(counts @ motion.lag_covariance(lags))


def _gaps(statistics: QuadraticStatistics) -> tuple[str, ...]:
    if statistics.gaps is None:
        return ()
    lost = int(np.sum(~statistics.gaps.present))
    return (f"{lost} lost frames: each lag is averaged over the pairs of frames that are there.",)
