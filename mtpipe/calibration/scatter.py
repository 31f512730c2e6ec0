"""Scatter beyond stated errors, of determinations of one quantity.

Metrologists call it dark uncertainty (Thompson & Ellison 2011, Accred. Qual. Assur. 16, 483).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import optimize, stats

from mtpipe.ground.types import FloatArray

# Half of a Gaussian's draws are within this many standard deviations.
HALF_WITHIN = float(stats.norm.ppf(0.75))


def scatter_beyond_errors(off: FloatArray, stderr: FloatArray) -> float:
    """Standard deviation that has to be added to the errors for differences to be about none.

    As Mandel and Paule (1970, Anal. Chem. 42, 1194) estimate it, about a known mean of 0: the τ ≥ 0
    with Σ off²/(stderr² + τ²) = n; or by the median of |off|/√(stderr² + τ²) in place of the mean
    square. The smaller of the two: one plateau that went astray exaggerates the first, an offset
    that all share the second.

    Parameters
    ----------
    off, stderr : (n,) differences that should be 0, and their standard errors.
    """

    def by_mean_square(scatter: float) -> float:
        return float(np.mean((off / np.hypot(stderr, scatter)) ** 2)) - 1

    def by_median(scatter: float) -> float:
        return float(np.median(np.abs(off) / np.hypot(stderr, scatter))) - HALF_WITHIN

    if not len(off):
        return 0.0
    most = 2 * float(np.max(np.abs(off)))
    return min(_root(by_mean_square, most), _root(by_median, most))


def _root(excess: Callable[[float], float], most: float) -> float:
    """Where a function that falls is 0; 0 where it begins below."""
    return float(optimize.brentq(excess, 0.0, most)) if excess(0.0) > 0 else 0.0
