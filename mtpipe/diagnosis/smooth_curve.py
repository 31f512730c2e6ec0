"""A smooth curve through points with errors, and how much they ask for one.

A Gaussian process about an unknown constant (Matérn covariance), of the size and length that have
the largest marginal likelihood.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from mtpipe.ground.types import FloatArray

# Sizes that are tried, in units of the points' own spread, and lengths, of their range.
SIZES, LENGTHS = (0.3, 1.0, 3.0), (0.1, 0.3, 1.0)
# In units of the points' whole spread: prior error of the constant, which is next to unknown, and
# the least error of a point, below which matrices cannot be inverted.
CONSTANT, LEAST_ERROR = 30.0, 1e-4


@dataclass(frozen=True, eq=False)
class SmoothCurve:
    """A curve at the points it was drawn through.

    Attributes
    ----------
    at, mean, stderr : (n,) where, the curve and its standard error.
    gain_nats : ln of the marginal likelihood over that of a constant.
    """

    at: FloatArray
    mean: FloatArray
    stderr: FloatArray
    gain_nats: float


def smooth_curve(at: FloatArray, values: FloatArray, stderr: FloatArray) -> SmoothCurve:
    """Draw the curve.

    Parameters
    ----------
    at, values, stderr : (n,) of the points; errors are independent.
    """
    centred = values - np.average(values, weights=stderr**-2.0)
    spread = float(centred.std())
    stderr = np.maximum(stderr, LEAST_ERROR * spread)
    constant = (CONSTANT * (spread + float(stderr.max()))) ** 2 * np.ones((len(at), len(at)))
    apart = np.abs(np.subtract.outer(at, at)) / float(np.ptp(at))
    noise = np.diag(stderr**2)
    without = _ln_evidence(constant + noise, centred)
    best, gain = constant, 0.0
    for size, length in itertools.product(SIZES, LENGTHS):
        prior = constant + matern(apart, size * spread, length)
        gained = _ln_evidence(prior + noise, centred) - without
        if gained > gain:
            best, gain = prior, gained
    solved = linalg.solve(best + noise, best, assume_a="pos")
    variance = np.diag(best) - np.einsum("ij,ij->j", best, solved)
    mean = values - centred + solved.T @ centred
    return SmoothCurve(at, mean, np.sqrt(np.maximum(variance, 0.0)), gain)


def matern(apart: FloatArray, size: float, length: float) -> FloatArray:
    """Covariance of order 3/2 (Rasmussen & Williams 2006, eq. 4.17) of points so far apart."""
    far = np.sqrt(3) * apart / length
    return np.asarray(size**2 * (1 + far) * np.exp(-far))


def _ln_evidence(covariance: FloatArray, values: FloatArray) -> float:
    root = np.linalg.cholesky(covariance)
    pulls = linalg.solve_triangular(root, values, lower=True)
    return float(-0.5 * pulls @ pulls - np.sum(np.log(np.diag(root))))
