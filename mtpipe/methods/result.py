"""What a calibration method hands back: the same estimates whatever the method."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.fit.estimates import logarithmic
from mtpipe.ground.estimate import Estimate, Status
from mtpipe.ground.status import status_of
from mtpipe.ground.types import FloatArray


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
    duration_s: float,
    converged: bool = True,
    friction_is_given: bool = False,
    notes: tuple[str, ...] = (),
) -> MethodFit:
    """Estimates from (ln k, ln γ) and their (2, 2) covariance.

    What is not known to better than a factor e has status "not_identified" and no value, and
    nothing has a value where the method did not converge. A stiffness that a random walk as long
    as the trace would show as well has status "zero_force".

    Parameters
    ----------
    duration_s : of the trace.
    """
    coordinates = {
        "stiffness": (np.array([1.0, 0.0]), "pN/nm"),
        "friction": (np.array([0.0, 1.0]), "pN s/nm"),
        "corner_frequency": (np.array([1.0, -1.0]), "Hz"),
    }
    if not converged:
        return without_values(method, notes, converged=False, noise=noise)
    estimates = {}
    for name, (direction, unit) in coordinates.items():
        ln_value = float(direction @ ln_values)
        if name == "corner_frequency":
            ln_value -= math.log(2 * math.pi)
        variance = float(direction @ covariance @ direction)
        found = logarithmic(ln_value, variance, unit, method, bias_removed=False)
        returns = math.inf if name == "friction" else duration_s * math.exp(ln_values @ (1, -1))
        estimates[name] = replace(found, status=status_of(found, relaxations=returns))
    if friction_is_given and estimates["friction"].status == "ok":
        estimates["friction"] = replace(estimates["friction"], status="fixed")
    return MethodFit(method, **estimates, noise=noise, converged=True, notes=notes)


def without_values(
    method: str, notes: tuple[str, ...], *, converged: bool = True, noise: Estimate | None = None
) -> MethodFit:
    """The result of a method that cannot tell anything from this trace, but perhaps its noise."""
    status: Status = "not_identified" if converged else "not_converged"
    stiffness, friction, unknown_noise, corner = (
        Estimate.missing(unit, method, status) for unit in ("pN/nm", "pN s/nm", "nm", "Hz")
    )
    return MethodFit(method, stiffness, friction, noise or unknown_noise, corner, converged, notes)
