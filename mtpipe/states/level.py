"""Steps of a level under white noise and a random walk: where, how large, how certain.

A series of block means u is a level that steps, white noise of each block, and what drifts (drift
left over, slow motion of a bead). Its differences d have the covariance white·(tridiagonal −1, 2,
−1) + walk·1, which the sine transform diagonalises; a step is a pulse in d. So noise is fitted by
exact likelihood, and each step is its best linear unbiased estimate; slow drift makes no steps, as
the walk fitted to it widens their errors.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy import fft, stats

from mtpipe.ground.types import FloatArray

# Ratios tried: variance of the random walk per block over that of the white noise; 0: no walk.
WALKS = np.concatenate([[0.0], np.geomspace(1e-4, 1e2, 19)])
# Likelihood over the best one's below which a noise is left out.
UNLIKELY = 1e-3
# Shorter series leave too little to tell noise from steps.
FEWEST_BLOCKS = 8


@dataclass(frozen=True)
class Noise:
    """Variance of the white noise of a block, and the walk's per block over it."""

    white: float
    walk_share: float


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
    small makes steps: errors are those of all walks, each weighted by its likelihood.
    """
    d = np.diff(level)
    noises, weights = _likely_noises(_without_step(d))
    sizes, variances = [], []
    for noise in noises:
        size, stderr = _steps(d, noise)
        sizes.append(size)
        variances.append(stderr**2)
    size = np.asarray(weights @ np.array(sizes))
    stderr = np.sqrt(weights @ np.array(variances))
    freedom = max(len(d) - 4, 2)
    tail = stats.t.logsf(np.abs(size / stderr), freedom)
    score = np.sign(size) * _normal_from_log_tail(tail)
    return StepScores(size, score, noises[int(np.argmax(weights))])


def fit_noise_about_step(level: FloatArray) -> Noise:
    """Noise of a series of block means (n,) without its strongest step."""
    return fit_noise(_without_step(np.diff(level)))


def _without_step(d: FloatArray) -> FloatArray:
    """Differences without the strongest step, which would pass as a walk."""
    size, stderr = _steps(d, fit_noise(d))
    strongest = int(np.argmax(np.abs(size / stderr)))
    without = d.copy()
    without[strongest] -= size[strongest]
    # a block within which the level steps shares the step with its neighbour
    near = [k for k in (strongest - 1, strongest + 1) if 0 <= k < len(d)]
    size, stderr = _steps(without, fit_noise(d))
    second = max(near, key=lambda k: abs(size[k] / stderr[k]))
    without[second] -= size[second]
    return without


def fit_noise(differences: FloatArray) -> Noise:
    """White noise and random walk of most likelihood, from differences of block means (n,)."""
    noises, weights = _likely_noises(differences)
    return noises[int(np.argmax(weights))]


def _likely_noises(differences: FloatArray) -> tuple[list[Noise], FloatArray]:
    """Noises by their share of the walk, and their likelihoods, which sum to 1."""
    n = len(differences)
    power = fft.dst(differences, type=1, norm="ortho") ** 2
    shape = WALKS[:, None] + _white_eigenvalues(n)
    white = np.maximum((power / shape).mean(axis=1), 1e-300)
    cost = n * np.log(white) + np.log(shape).sum(axis=1)
    weights = np.exp((cost.min() - cost) / 2)
    likely = np.flatnonzero(weights > UNLIKELY)
    noises = [Noise(float(white[i]), float(WALKS[i])) for i in likely]
    return noises, np.asarray(weights[likely] / weights[likely].sum())


def _steps(d: FloatArray, noise: Noise) -> tuple[FloatArray, FloatArray]:
    """Size and standard error of a step at each place (generalised least squares)."""
    eigen = noise.white * (noise.walk_share + _white_eigenvalues(len(d)))
    solved = fft.dst(fft.dst(d, type=1, norm="ortho") / eigen, type=1, norm="ortho")
    precision = _squared_sines(len(d)) @ (1 / eigen)
    return solved / precision, precision**-0.5


@functools.lru_cache(maxsize=64)
def _white_eigenvalues(n: int) -> FloatArray:
    return np.asarray(2 - 2 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1)))


@functools.lru_cache(maxsize=8)
def _squared_sines(n: int) -> FloatArray:
    """(place, mode) squared eigenvectors of the differences' covariance."""
    j = np.arange(1, n + 1)
    return np.asarray(2 / (n + 1) * np.sin(np.pi * np.outer(j, j) / (n + 1)) ** 2)


def _normal_from_log_tail(log_tail: FloatArray) -> FloatArray:
    """The standard normal number that is exceeded as rarely."""
    exact = stats.norm.isf(np.exp(np.maximum(log_tail, -700.0)))
    return np.asarray(np.where(log_tail < -700.0, np.sqrt(-2 * log_tail), exact))
