"""Steps of a level under thermal noise and a random walk: where, how large, how certain.

A series of block means u is a level that steps, noise of each block, and what drifts (drift left
over, slow motion of a bead). Its differences d have the covariance white·(tridiagonal −1, 2, −1) +
walk·1, which the sine transform diagonalises; a step is a pulse in d. So noise is fitted by
likelihood, and each step is its best linear unbiased estimate; slow drift makes no steps, as the
walk fitted to it widens their errors. Where blocks are as short as a bead's relaxation, neighbours
are alike; the transform is then a good approximation, but for the ends.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft, stats

from mtpipe.ground.types import FloatArray

# Ratios tried: variance of the random walk per block over that of the white noise; 0: no walk.
WALKS = np.concatenate([[0.0], np.geomspace(1e-4, 1e2, 19)])
# Blocks within which a coordinate may relax; 0: blocks are independent of one another.
RELAXATIONS = (0.0, 0.125, 0.25, 0.35, 0.5, 0.7, 1.0)
# Where blocks are wide, that is all.
WHITE = (0.0,)
# Likelihood over the best one's below which a noise is left out.
UNLIKELY = 1e-3
# Shorter series leave too little to tell noise from steps.
FEWEST_BLOCKS = 8


@dataclass(frozen=True)
class Noise:
    """Noise of block means: what relaxes, and a walk.

    `white` : variance of a block, as slow noise has it. `walk_share` : the walk's per block over
    it. `relaxation` : blocks within which the rest relaxes, 0 for white noise.
    """

    white: float
    walk_share: float
    relaxation: float = 0.0


@dataclass(frozen=True)
class StepScores:
    """Steps between neighbouring blocks, each taken as the only one.

    `size` (n − 1,) and `score` (n − 1,): size over its standard error, as a standard normal number
    where there is no step (Student's distribution taken into account).
    """

    size: FloatArray
    score: FloatArray
    noise: Noise


def step_scores(level: FloatArray) -> StepScores:
    """Score every place of a series of block means for a step.

    Parameters
    ----------
    level : (n,), n at least FEWEST_BLOCKS, without NaN.

    How much of the noise is a walk is uncertain in a short series, and a walk that is taken for too
    small makes steps: errors are those of all walks and relaxations, each weighted by its
    likelihood.
    """
    d = np.diff(level)
    noises, weights = _likely_noises(_without_step(d))
    sizes, stderrs = _steps(d, noises)
    size = np.asarray(weights @ sizes)
    stderr = np.sqrt(weights @ stderrs**2)
    freedom = max(len(d) - 4, 2)
    tail = stats.t.logsf(np.abs(size / stderr), freedom)
    score = np.sign(size) * _normal_from_log_tail(tail)
    return StepScores(size, score, noises[int(np.argmax(weights))])


def usual_score(level: FloatArray, noise: Noise) -> float:
    """Root mean square score of the steps that a level of its own, (n,), makes beside a noise."""
    size, stderr = _steps(np.diff(level), [noise])
    return float(np.sqrt(np.mean((size / stderr) ** 2)))


def fit_noise_about_step(level: FloatArray) -> Noise:
    """White noise and walk of a series of block means (n,) without its strongest step."""
    return fit_noise(_without_step(np.diff(level), WHITE), WHITE)


def _without_step(d: FloatArray, relaxations: tuple[float, ...] = RELAXATIONS) -> FloatArray:
    """Differences without the strongest step, which would pass as a walk."""
    noise = fit_noise(d, relaxations)
    (size,), (stderr,) = _steps(d, [noise])
    strongest = int(np.argmax(np.abs(size / stderr)))
    without = d.copy()
    without[strongest] -= size[strongest]
    # a block within which the level steps shares the step with its neighbour
    near = [k for k in (strongest - 1, strongest + 1) if 0 <= k < len(d)]
    (size,), (stderr,) = _steps(without, [noise])
    second = max(near, key=lambda k: abs(size[k] / stderr[k]))
    without[second] -= size[second]
    return without


def fit_noise(differences: FloatArray, relaxations: tuple[float, ...] = RELAXATIONS) -> Noise:
    """Noise of most likelihood, from differences of block means (n,)."""
    noises, weights = _likely_noises(differences, relaxations)
    return noises[int(np.argmax(weights))]


def _likely_noises(
    differences: FloatArray, relaxations: tuple[float, ...] = RELAXATIONS
) -> tuple[list[Noise], FloatArray]:
    """Noises by walk and relaxation, and their likelihoods, which sum to 1."""
    n = len(differences)
    power = fft.dst(differences, type=1, norm="ortho") ** 2
    shape = _shapes(n, relaxations)
    white = np.maximum((power / shape).mean(axis=1), 1e-300)
    cost = n * np.log(white) + np.log(shape).sum(axis=1)
    weights = np.exp((cost.min() - cost) / 2)
    likely = np.flatnonzero(weights > UNLIKELY)
    noises = [
        Noise(float(white[i]), float(WALKS[i % len(WALKS)]), relaxations[i // len(WALKS)])
        for i in likely
    ]
    return noises, np.asarray(weights[likely] / weights[likely].sum())


def _steps(d: FloatArray, noises: Sequence[Noise]) -> tuple[FloatArray, FloatArray]:
    """(noises, n) sizes and standard errors of a step at each place (generalised least squares)."""
    eigen = np.array([
        noise.white * (noise.walk_share + _eigenvalues(len(d), noise.relaxation))
        for noise in noises
    ])  # fmt: skip
    solved = fft.dst(fft.dst(d, type=1, norm="ortho") / eigen, type=1, norm="ortho")
    precision = (1 / eigen) @ _squared_sines(len(d))
    return solved / precision, precision**-0.5


@functools.lru_cache(maxsize=16)
def _shapes(n: int, relaxations: tuple[float, ...]) -> FloatArray:
    """(relaxations x walks, n) variances of the modes of all noises, over that of slow noise."""
    each = np.array([_eigenvalues(n, relaxation) for relaxation in relaxations])
    return np.asarray((each[:, None] + WALKS[:, None]).reshape(-1, n))


@functools.lru_cache(maxsize=256)
def _eigenvalues(n: int, relaxation: float) -> FloatArray:
    """(n,) of differences of block means, over the variance of slow noise.

    What relaxes exponentially has block means whose covariances fall by exp(-1 / relaxation) from
    block to block; their spectrum is that of neighbours and of a geometric series.
    """
    angle = np.pi * np.arange(1, n + 1) / (n + 1)
    white = 2 - 2 * np.cos(angle)
    if relaxation == 0:
        return np.asarray(white)
    long = 1 / relaxation
    falls = math.exp(-long)
    own = 2 * (long - 1 + falls) / long**2
    next_one = ((1 - falls) / long) ** 2
    series = (np.cos(angle) - falls) / (1 - 2 * falls * np.cos(angle) + falls**2)
    slow = own + 2 * next_one / (1 - falls)
    return np.asarray(white * (own + 2 * next_one * series) / slow)


@functools.lru_cache(maxsize=8)
def _squared_sines(n: int) -> FloatArray:
    """(place, mode) squared eigenvectors of the differences' covariance."""
    j = np.arange(1, n + 1)
    return np.asarray(2 / (n + 1) * np.sin(np.pi * np.outer(j, j) / (n + 1)) ** 2)


def _normal_from_log_tail(log_tail: FloatArray) -> FloatArray:
    """The standard normal number that is exceeded as rarely."""
    exact = stats.norm.isf(np.exp(np.maximum(log_tail, -700.0)))
    return np.asarray(np.where(log_tail < -700.0, np.sqrt(-2 * log_tail), exact))
