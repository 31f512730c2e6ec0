"""Estimates from what was fitted: coordinates and their covariance become numbers with errors.

For all fits of stiffness, friction and noise. What a fit knows to a factor of no better than e has
no value, and is said to be not identified.
"""

from __future__ import annotations

import math

import numpy as np

from mtpipe.fit.model import PRIOR_HALF_WIDTH
from mtpipe.ground.estimate import Estimate, Status
from mtpipe.ground.types import FloatArray

# A parameter known to a factor of no better than e is not called a measurement.
NOT_IDENTIFIED_LN = 1.0
QUANTITIES = ("stiffness", "friction", "tracking noise")
TIED_CORRELATION = 0.8


def logarithmic(
    ln_value: float,
    variance: float,
    unit: str,
    method: str,
    *,
    bias_removed: bool = True,
    tied_to: tuple[str, ...] = (),
    reach: FloatArray | None = None,
) -> Estimate:
    """The estimate of a positive quantity from its logarithm and the variance of that.

    exp of an unbiased estimate is high by half its variance (1 % for an error of 14 %), which is
    taken off the value; the interval needs no such correction.

    Parameters
    ----------
    bias_removed : False for a method that is to be reported as its authors have it.
    tied_to : what it cannot be told from, for a quantity that turns out not to be identified.
    reach : (2,) how far down and up the logarithm may lie, where that is known better than by the
        variance.
    """
    if reach is not None:
        # beyond all that is believed possible beforehand there is no end
        down, up = (float(far) if far < PRIOR_HALF_WIDTH else math.inf for far in reach)
        interval = (math.exp(ln_value - down), math.exp(ln_value + up))
        if max(down, up) > NOT_IDENTIFIED_LN:
            return Estimate.missing(unit, method, interval=interval, tied_to=tied_to)
        value = math.exp(ln_value)
        return Estimate(value, value * (down + up) / 2, interval, unit, method)
    sigma = math.sqrt(max(float(variance), 0.0))
    if not sigma < PRIOR_HALF_WIDTH:
        return Estimate.missing(unit, method, interval=(0.0, math.inf), tied_to=tied_to)
    interval = (math.exp(ln_value - sigma), math.exp(ln_value + sigma))
    if sigma > NOT_IDENTIFIED_LN:
        return Estimate.missing(unit, method, interval=interval, tied_to=tied_to)
    value = math.exp(ln_value - sigma**2 / 2 if bias_removed else ln_value)
    return Estimate(value, value * sigma, interval, unit, method)


def known_noise(variance_nm2: float, method: str) -> Estimate:
    """Tracking noise that was given and not fitted."""
    value = math.sqrt(variance_nm2)
    return Estimate(value, 0.0, (value, value), "nm", method, "fixed")


def fitted_noise(
    variance_nm2: float, stderr_nm2: float, method: str, *, zero_nm2: float = 0.0
) -> Estimate:
    """Tracking noise from its fitted variance ε² ≥ 0; at zero the interval is one-sided.

    `zero_nm2` : the largest variance that is indistinguishable from none.
    """
    low, value, high = (
        math.sqrt(max(variance_nm2 + step * stderr_nm2, 0.0)) for step in (-1, 0, 1)
    )
    # half the interval: the standard error of a square root is no derivative near zero
    status: Status = "at_bound" if variance_nm2 <= zero_nm2 else "ok"
    return Estimate(value, (high - low) / 2, (low, high), "nm", method, status)


def fitted_log_noise(ln_variance: float, stderr: float, method: str) -> Estimate:
    """Tracking noise from ln ε², fitted with a prior."""
    low, value, high = (math.exp((ln_variance + step * stderr) / 2) for step in (-1, 0, 1))
    return Estimate(value, (high - low) / 2, (low, high), "nm", method)


def tied(covariance: FloatArray, free: tuple[int, ...]) -> tuple[str, ...]:
    """Names of the parameters that cannot be told apart, from the (3, 3) covariance of a fit.

    They move together: their estimates are correlated with the stiffness's by more than 0.8. Beyond
    the Nyquist frequency friction and stiffness do, and tracking noise, if it is fitted, with them;
    a shorter exposure would look the same as more noise (PHYSICS 3.A).
    """
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance[0] / (sigma * sigma[0])
    found = [QUANTITIES[i] for i in free if i == 0 or abs(correlation[i]) > TIED_CORRELATION]
    return (*found, "exposure") if QUANTITIES[2] in found else tuple(found)


def inverse_information(information: FloatArray) -> FloatArray:
    """Inverse of a Fisher matrix; directions that are not determined get a huge variance."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-20))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    scaled = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    return np.asarray(scaled / np.outer(size, size))
