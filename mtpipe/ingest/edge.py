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

from mtpipe.ground.types import FloatArray

LOWER_PART = 0.5
FARTHEST_BELOW = 4.0
FEWEST_VALUES = 100
FEWEST_BINS, MOST_BINS, VALUES_PER_BIN = 20, 100, 3
NARROWEST_NM = 1e-6
BLOCKS = 4
HIGHEST_POWER = 2.0
WORTH_A_POWER = 2e-3  # nats per value by which m > 0 must be better
OUTLIERS = 1e-3
MISTRACKED = 10.0  # in medians of the steps
STARTS = ((-1.0, 0.0, 0.0), (-0.3, 0.0, -3.0), (-0.02, 3.0, -30.0))  # edge, noise, slope


def lower_edge_nm(z_nm: FloatArray) -> tuple[float, float]:
    """Lower edge of the heights of a bead that touches the surface, and its standard error.

    Parameters
    ----------
    z_nm : (n,) in time order, NaN ignored. The error is from the scatter among successive
        quarters of the trace, as neighbouring heights are correlated.

    Raises
    ------
    ValueError : fewer than 100 values.
    """
    values = z_nm[np.isfinite(z_nm)]
    if len(values) < FEWEST_VALUES:
        raise ValueError(f"{len(values)} values are too few, {FEWEST_VALUES} are needed")
    whole = _Histogram.of(values)
    best = _fitted(whole)
    blocks = []
    for piece in np.array_split(values, BLOCKS):
        data = _Histogram.of(piece)
        blocks.append(data.height_nm(_best(data, best)[0]))
    stderr = float(np.std(blocks, ddof=1) / math.sqrt(BLOCKS))
    return whole.height_nm(best), stderr


def largest_noise_nm(z_nm: FloatArray) -> float:
    """Bound on white noise from the covariance of successive steps, -cov = noise^2.

    Diffusion leaves the covariance as it is, and the blur of a frame only lowers the bound.
    Steps far beyond the usual are mistracking.
    """
    step = np.diff(z_nm)
    farthest = MISTRACKED * float(np.median(np.abs(step)))
    step = np.where(np.abs(step) > farthest, 0.0, step)
    return math.sqrt(max(0.0, -float(np.mean(step[1:] * step[:-1]))))


@dataclass(frozen=True)
class _Histogram:
    """The lower part of the values: bins in units of its `width_nm`, 0 at its top.

    `share` sums to 1; `noise` is the largest that time allows, in the same units.
    """

    top_nm: float
    width_nm: float
    centre: FloatArray
    share: FloatArray
    noise: float

    @classmethod
    def of(cls, values: FloatArray) -> _Histogram:
        top = float(np.quantile(values, LOWER_PART))
        width = max(top - float(np.quantile(values, 0.1 * LOWER_PART)), NARROWEST_NM)
        low = values[(values <= top) & (values > top - FARTHEST_BELOW * width)]
        bins = int(np.clip(len(low) // VALUES_PER_BIN, FEWEST_BINS, MOST_BINS))
        counts, edges = np.histogram((low - top) / width, bins=bins)
        noise = max(largest_noise_nm(values) / width, 2 * float(edges[1] - edges[0]))
        return cls(top, width, 0.5 * (edges[1:] + edges[:-1]), counts / counts.sum(), noise)

    @property
    def step(self) -> float:
        return float(self.centre[1] - self.centre[0])

    def height_nm(self, parameters: FloatArray) -> float:
        """Edge that a fit's parameters mean."""
        return self.top_nm + self.width_nm * float(parameters[0])


def _fitted(data: _Histogram) -> FloatArray:
    sharp = [_best(data, np.array(start)) for start in STARTS]
    best, cost = min(sharp, key=lambda found: found[1])
    for edge in (best[0], best[0] - 0.2):
        soft, soft_cost = _best(data, np.array([edge, best[1], best[2], -1.0]))
        if soft_cost < cost - WORTH_A_POWER:
            best, cost = soft, soft_cost
    return best


def _best(data: _Histogram, start: FloatArray) -> tuple[FloatArray, float]:
    def cost(parameters: FloatArray) -> float:
        return _cost(data, parameters)

    fit = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"maxiter": 600, "fatol": 1e-6, "xatol": 5e-4},
    )
    return np.asarray(fit.x), float(fit.fun)


def _cost(data: _Histogram, parameters: FloatArray) -> float:
    """Minus the log-likelihood per value of (edge, noise, slope[, power]).

    Noise and power are logistic in their parameters, so that they stay within their bounds.
    """
    edge, slope = float(parameters[0]), float(parameters[2])
    step = data.step
    noise = data.noise * float(expit(parameters[1]))
    power = HIGHEST_POWER * float(expit(parameters[3])) if len(parameters) == 4 else 0.0
    reach = min(len(data.centre), math.ceil(5 * noise / step))
    if edge < data.centre[0] - reach * step:  # no value shows such an edge
        return 1e3 - edge
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
    expected = (1 - OUTLIERS) * blurred / total + OUTLIERS / len(data.centre)
    # weak priors where edge, noise and slope trade: a bead at rest shows its noise alone
    prior = 1e-8 * slope**2 + 1e-5 * abs(float(parameters[1]))
    return prior - float(data.share @ np.log(expected))
