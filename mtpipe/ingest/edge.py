"""The lower edge of a distribution of heights: where the surface is.

The lowest value of a noisy trace depends on how long one waits; the edge of its distribution does
not. Above the surface a bead's height u >= 0 has the density u^m exp(a u): m = 0 for a bead that
rests on the surface or is pressed against it (a barometric law), m > 0 for one that its tether
keeps from touching for long, a of either sign. The tracker adds Gaussian noise. Edge, noise, a
and m are fitted to the lower half of the values by maximum likelihood, m only where it earns its
keep. What tells noise from motion is time: noise is new in every frame, so that the noise is at
most what the covariance of successive steps says (-cov = noise^2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from mtpipe.recording import FloatArray

LOWER_PART = 0.5
FARTHEST_BELOW = 4.0
FEWEST_VALUES = 400
BINS = 250
BLOCKS = 4
HIGHEST_POWER = 2.0
WORTH_A_POWER = 2e-3  # nats per value by which m > 0 must be better
OUTLIERS = 1e-3


def lower_edge_nm(z_nm: FloatArray) -> tuple[float, float]:
    """Lower edge of the heights of a bead that touches the surface, and its standard error.

    Parameters
    ----------
    z_nm : (n,) in time order, NaN ignored. The error is from the scatter among successive
        quarters of the trace, as neighbouring heights are correlated.

    Raises
    ------
    ValueError : fewer than 400 values.
    """
    values = z_nm[np.isfinite(z_nm)]
    if len(values) < FEWEST_VALUES:
        raise ValueError(f"{len(values)} values are too few, {FEWEST_VALUES} are needed")
    edge = _fitted(values)
    blocks = [_fitted(block) for block in np.array_split(values, BLOCKS)]
    return edge, float(np.std(blocks, ddof=1) / math.sqrt(BLOCKS))


def largest_noise_nm(z_nm: FloatArray) -> float:
    """Bound on white noise from the covariance of successive steps, -cov = noise^2.

    Diffusion leaves the covariance as it is, and the blur of a frame only lowers the bound.
    """
    step = np.diff(z_nm)
    return math.sqrt(max(0.0, -float(np.mean(step[1:] * step[:-1]))))


@dataclass(frozen=True)
class _Histogram:
    """The lower part of the values, in units of its own width; `share` sums to 1."""

    centre: FloatArray
    share: FloatArray
    largest_noise: float

    @property
    def bin_width(self) -> float:
        return float(self.centre[1] - self.centre[0])


def _fitted(values: FloatArray) -> float:
    top = float(np.quantile(values, LOWER_PART))
    width = top - float(np.quantile(values, 0.1 * LOWER_PART))
    if width == 0:
        return top
    low = values[(values <= top) & (values > top - FARTHEST_BELOW * width)]
    counts, edges = np.histogram((low - top) / width, bins=BINS)
    data = _Histogram(
        0.5 * (edges[1:] + edges[:-1]), counts / counts.sum(), largest_noise_nm(values) / width
    )
    sharp = [_best(data, [start, 0.0, slope]) for start, slope in ((-1.0, 0.0), (-0.3, -3.0))]
    best, cost = min(sharp, key=lambda found: found[1])
    for start in (best[0], best[0] - 0.2):
        soft, soft_cost = _best(data, [start, best[1], best[2], -1.0])
        if soft_cost < cost - WORTH_A_POWER:
            best, cost = soft, soft_cost
    return top + width * float(best[0])


def _best(data: _Histogram, start: list[float]) -> tuple[FloatArray, float]:
    fit = minimize(lambda p: _cost(data, p), start, method="Nelder-Mead", options={"maxiter": 800})
    return np.asarray(fit.x), float(fit.fun)


def _cost(data: _Histogram, parameters: FloatArray) -> float:
    """Minus the log-likelihood per value of (edge, noise, slope[, power]).

    Noise and power are logistic in their parameters, so that they stay within their bounds.
    """
    edge, slope = float(parameters[0]), float(parameters[2])
    step = data.bin_width
    noise = max(data.largest_noise, 2 * step) * float(expit(parameters[1]))
    power = HIGHEST_POWER * float(expit(parameters[3])) if len(parameters) == 4 else 0.0
    reach = min(BINS, math.ceil(5 * noise / step))
    # bins beyond both ends, from where noise brings values in
    below = data.centre[0] - step * np.arange(reach, 0, -1)
    above = data.centre[-1] + step * np.arange(1, reach + 1)
    height = np.concatenate([below, data.centre, above]) - edge
    upper = np.maximum(height + step / 2, 0) ** (power + 1)
    lower = np.maximum(height - step / 2, 0) ** (power + 1)
    density = (upper - lower) * np.exp(np.clip(slope * height, -300, 300))
    kernel = np.exp(-0.5 * (step * np.arange(-reach, reach + 1) / max(noise, 0.3 * step)) ** 2)
    blurred = np.convolve(density, kernel, mode="valid")
    total = float(blurred.sum())
    if not (total > 0 and math.isfinite(total)):
        return 1e3 + abs(edge)
    expected = (1 - OUTLIERS) * blurred / total + OUTLIERS / BINS
    # weak priors where edge, noise and slope trade: a bead at rest shows its noise alone
    return float(-data.share @ np.log(expected)) + 1e-6 * slope**2 + 1e-4 * abs(parameters[1])
