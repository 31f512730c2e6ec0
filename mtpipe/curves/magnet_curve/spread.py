"""What beads differ by: one factor each on all forces, ln-normal, of a width that is estimated.

Given the curve all is Gaussian: the forces of a bead have covariance D + s² 1 1ᵀ, with D of their
own errors. s is estimated by restricted maximum likelihood (Patterson & Thompson 1971), which
allows for the parameters of the curve that the same beads pay for.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from mtpipe.curves.magnet_curve.measured import Forces
from mtpipe.ground.types import FloatArray

# A drop of −2 ln L that bounds the 68 % interval.
ONE_SIGMA = 1.0


def whitened(forces: Forces, spread: float, values: FloatArray) -> FloatArray:
    """Values, (n,) or (n, k), in units in which their covariance is the unit matrix."""
    wide = values.reshape(len(values), -1)
    root = np.sqrt(forces.variance)
    own = 1 / root
    total = forces.sums(own**2)
    scaled = wide * own[:, None]
    share = (1 - 1 / np.sqrt(1 + spread**2 * total)) / total
    means = forces.sums(scaled * own[:, None]) * share[:, None]
    return np.asarray((scaled - own[:, None] * means[forces.bead]).reshape(values.shape))


def deviance(forces: Forces, spread: float, residuals: FloatArray) -> float:
    """−2 ln L of residuals of ln F, (n,), about a given curve."""
    n = len(residuals)
    return (
        float(np.sum(whitened(forces, spread, residuals) ** 2))
        + _log_det(forces, spread)
        + (n * float(np.log(2 * np.pi)))
    )


def restricted_deviance(
    forces: Forces, spread: float, residuals: FloatArray, jacobian: FloatArray
) -> float:
    """−2 ln of the likelihood that is left when the curve's parameters are integrated out."""
    both = whitened(forces, spread, np.column_stack([jacobian, residuals]))
    q, r = np.linalg.qr(both[:, :-1])
    left = both[:, -1] - q @ (q.T @ both[:, -1])
    information = 2 * float(np.sum(np.log(np.abs(np.diag(r)) + np.finfo(float).tiny)))
    return float(left @ left) + _log_det(forces, spread) + information


def most_likely_spread(
    forces: Forces, residuals: FloatArray, jacobian: FloatArray
) -> tuple[float, float, float]:
    """Spread of ln F from bead to bead, and its 68 % interval (restricted likelihood ratio).

    Parameters
    ----------
    residuals : (n,) of ln F about the curve. jacobian : (n, k) of the curve at its parameters.
    """

    def at(spread: float) -> float:
        return restricted_deviance(forces, spread, residuals, jacobian)

    weight = forces.sums(1 / forces.variance)
    means = forces.sums(residuals / forces.variance) / weight
    upper = 10 * float(np.std(means)) + float(np.sqrt(np.mean(1 / weight)))
    found = minimize_scalar(at, bounds=(0.0, upper), method="bounded", options={"xatol": 1e-6})
    best, least = (0.0, at(0.0)) if at(0.0) <= found.fun else (float(found.x), float(found.fun))

    def above(spread: float) -> float:
        return at(spread) - least - ONE_SIGMA

    low = 0.0 if above(0.0) <= 0 else float(brentq(above, 0.0, best))
    far = max(upper, 2 * best)
    while above(far) < 0:
        far *= 2
    return best, low, float(brentq(above, best, far))


def _log_det(forces: Forces, spread: float) -> float:
    total = forces.sums(1 / forces.variance)
    return float(np.sum(np.log(forces.variance)) + np.sum(np.log1p(spread**2 * total)))
