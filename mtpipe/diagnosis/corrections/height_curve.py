"""A curve through which heights are read, and what it does to steps from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from mtpipe.ground.types import FloatArray

# Shares of the heights below each point of the curve: outside, few frames say how it goes on.
SHARES = np.linspace(0.02, 0.98, 13)


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


def standardised(z: FloatArray) -> FloatArray:
    """Heights about their mean, in standard deviations."""
    return np.asarray((z - np.nanmean(z)) / np.nanstd(z))


def fast_by_height(z: FloatArray) -> FloatArray:
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


def share_of_way(
    fast: FloatArray, straight: FloatArray, foretold: FloatArray
) -> tuple[float, float]:
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


def _through(x: FloatArray, y: FloatArray, values: FloatArray) -> FloatArray:
    """A smooth rising curve through points, and straight on beyond them."""
    curve = PchipInterpolator(x, y)
    inside = np.clip(values, x[0], x[-1])
    below = (y[1] - y[0]) / (x[1] - x[0]) * np.minimum(values - x[0], 0.0)
    above = (y[-1] - y[-2]) / (x[-1] - x[-2]) * np.maximum(values - x[-1], 0.0)
    return np.asarray(curve(inside) + below + above)
