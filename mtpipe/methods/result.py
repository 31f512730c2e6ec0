"""What a calibration method hands back: the same estimates whatever the method."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtpipe.estimate import Estimate, Status
from mtpipe.fit.trace import NOT_IDENTIFIED_LN
from mtpipe.physics.camera import FloatArray


@dataclass(frozen=True)
class MethodFit:
    """Result of `fit_by_method`.

    Attributes
    ----------
    method : its name.
    stiffness : pN/nm. friction : pN s/nm. noise : nm. corner_frequency : Hz, k/(2πγ).
    converged : whether the method's own iteration came to rest.
    notes : one sentence for each thing the method did or did not do that the numbers do not show.
    """

    method: str
    stiffness: Estimate
    friction: Estimate
    noise: Estimate
    corner_frequency: Estimate
    converged: bool
    notes: tuple[str, ...]


def describe(
    method: str,
    ln_values: FloatArray,
    covariance: FloatArray,
    noise: Estimate,
    *,
    converged: bool = True,
    friction_is_given: bool = False,
    notes: tuple[str, ...] = (),
) -> MethodFit:
    """Estimates from (ln k, ln γ) and their (2, 2) covariance.

    What is not known to better than a factor e has status "not_identified" and no value, and
    nothing has a value where the method did not converge.
    """
    coordinates = {
        "stiffness": (np.array([1.0, 0.0]), "pN/nm"),
        "friction": (np.array([0.0, 1.0]), "pN s/nm"),
        "corner_frequency": (np.array([1.0, -1.0]), "Hz"),
    }
    estimates = {}
    for name, (direction, unit) in coordinates.items():
        ln_value = float(direction @ ln_values)
        if name == "corner_frequency":
            ln_value -= math.log(2 * math.pi)
        variance = float(direction @ covariance @ direction)
        status: Status = "fixed" if name == "friction" and friction_is_given else "ok"
        if not converged:
            status = "not_converged"
        estimates[name] = _logarithmic(ln_value, variance, unit, method, status)
    return MethodFit(method, **estimates, noise=noise, converged=converged, notes=notes)


def without_values(method: str, notes: tuple[str, ...], *, converged: bool = True) -> MethodFit:
    """The result of a method that cannot tell anything from this trace."""
    status: Status = "not_identified" if converged else "not_converged"
    stiffness, friction, noise, corner = (
        Estimate.missing(unit, method, status) for unit in ("pN/nm", "pN s/nm", "nm", "Hz")
    )
    return MethodFit(method, stiffness, friction, noise, corner, converged, notes)


def known_noise(noise_variance_nm2: float, method: str) -> Estimate:
    """Tracking noise that was given and not fitted."""
    value = math.sqrt(noise_variance_nm2)
    return Estimate(value, 0.0, (value, value), "nm", method, "fixed")


def fitted_noise(variance_nm2: float, stderr_nm2: float, method: str) -> Estimate:
    """Tracking noise from its fitted variance ε² ≥ 0; at zero the interval is one-sided."""
    low, value, high = (
        math.sqrt(max(variance_nm2 + step * stderr_nm2, 0.0)) for step in (-1, 0, 1)
    )
    # half the interval: the standard error of a square root is no derivative near zero
    status: Status = "at_bound" if variance_nm2 == 0 else "ok"
    return Estimate(value, (high - low) / 2, (low, high), "nm", method, status)


def _logarithmic(
    ln_value: float, variance: float, unit: str, method: str, status: Status
) -> Estimate:
    sigma = math.sqrt(max(variance, 0.0)) if math.isfinite(variance) else math.inf
    if status == "not_converged":
        return Estimate.missing(unit, method, status)
    if not sigma < 5 * NOT_IDENTIFIED_LN:
        return Estimate(math.nan, math.nan, (0.0, math.inf), unit, method, "not_identified")
    value = math.exp(ln_value)
    interval = (math.exp(ln_value - sigma), math.exp(ln_value + sigma))
    if sigma > NOT_IDENTIFIED_LN:
        return Estimate(math.nan, math.nan, interval, unit, method, "not_identified")
    return Estimate(value, value * sigma, interval, unit, method, status)
