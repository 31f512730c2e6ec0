"""One form of the curve fitted to forces of beads, and the choice among the forms."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from mtpipe.curves.magnet_curve.forms import Form, forms
from mtpipe.curves.magnet_curve.measured import Forces
from mtpipe.curves.magnet_curve.spread import deviance, most_likely_spread, whitened
from mtpipe.ground.types import FloatArray

# Most rounds in which curve and spread are fitted in turn, and the relative change of the spread
# that ends them.
ROUNDS, SETTLED = 6, 1e-2
# A parameter nearer to its bound is at it: it is known to be there, and has no error.
AT_BOUND = 1e-6


@dataclass(frozen=True)
class FormFit:
    """A form at its most likely parameters.

    Attributes
    ----------
    origin_mm, sign : distance is sign · (position − origin).
    theta : (k,) parameters. covariance : (k, k), nought where one is at its bound.
    spread, spread_low, spread_high : of ln F from bead to bead; 68 %.
    bic : Bayesian information criterion, of the forces' logarithms.
    """

    form: Form
    origin_mm: float
    sign: int
    theta: FloatArray
    covariance: FloatArray
    spread: float
    spread_low: float
    spread_high: float
    bic: float

    def log_force(self, position_mm: FloatArray) -> FloatArray:
        """(n,) ln of the curve's force in pN."""
        return self.form.value(self.theta, self._distance(position_mm))

    def jacobian(self, position_mm: FloatArray) -> FloatArray:
        """Derivatives by the parameters, (n, k)."""
        return self.form.jacobian(self.theta, self._distance(position_mm))

    def variance(self, position_mm: FloatArray) -> FloatArray:
        """(n,) variance of the curve's ln F."""
        jacobian = self.jacobian(position_mm)
        return np.asarray(np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian))

    def _distance(self, position_mm: FloatArray) -> FloatArray:
        return self.sign * (np.asarray(position_mm, dtype=np.float64) - self.origin_mm)


def best_fit(forces: Forces) -> tuple[FormFit, dict[str, float]]:
    """The form of the least BIC, and the least BIC of each form by name.

    Parameters
    ----------
    forces : of at least two beads, at three positions or more.
    """
    origin_mm, sign = _orientation(forces)
    distance = sign * (forces.position_mm - origin_mm)
    fits = [_fit(form, forces, origin_mm, sign) for form in forms(distance, forces.log_force)]
    least: dict[str, float] = {}
    for fit in fits:
        least[fit.form.name] = min(fit.bic, least.get(fit.form.name, math.inf))
    return min(fits, key=lambda fit: fit.bic), least


def _orientation(forces: Forces) -> tuple[float, int]:
    """Middle of the positions, and 1 where the force falls with the position, else −1.

    By the slopes within beads, so that no bead's own factor counts.
    """
    weight = 1 / forces.variance
    total = forces.sums(weight)

    def within(values: FloatArray) -> FloatArray:
        means = forces.sums(weight * values) / total
        return np.asarray(values - means[forces.bead])

    product = float(np.sum(weight * within(forces.position_mm) * within(forces.log_force)))
    return float(np.mean(forces.positions_mm)), 1 if product <= 0 else -1


def _fit(form: Form, forces: Forces, origin_mm: float, sign: int) -> FormFit:
    distance, log_force = sign * (forces.position_mm - origin_mm), forces.log_force
    spread, starts = 0.1, form.starts
    for _ in range(ROUNDS):
        theta = _theta(form, forces, distance, spread, starts)
        free = theta - form.lower > AT_BOUND
        jacobian = form.jacobian(theta, distance)[:, free]
        residuals = log_force - form.value(theta, distance)
        before = spread
        spread, low, high = most_likely_spread(forces, residuals, jacobian)
        starts = (theta,)
        if abs(spread - before) <= SETTLED * before:
            break
    root = whitened(forces, spread, jacobian)
    covariance = np.zeros((len(theta), len(theta)))
    covariance[np.ix_(free, free)] = np.linalg.pinv(root.T @ root, hermitian=True)
    told = deviance(forces, spread, residuals)
    bic = told + (len(theta) + 1) * math.log(len(log_force))
    return FormFit(form, origin_mm, sign, theta, covariance, spread, low, high, bic)


def _theta(
    form: Form, forces: Forces, distance: FloatArray, spread: float, starts: tuple[FloatArray, ...]
) -> FloatArray:
    def residuals(theta: FloatArray) -> FloatArray:
        return whitened(forces, spread, forces.log_force - form.value(theta, distance))

    def slopes(theta: FloatArray) -> FloatArray:
        return -whitened(forces, spread, form.jacobian(theta, distance))

    # fits begin inside their bounds
    inside = np.where(np.isfinite(form.lower), form.lower + 1e-9, form.lower)
    ends = [
        least_squares(
            residuals,
            np.maximum(start, inside),
            jac=slopes,
            bounds=(form.lower, np.inf),
            x_scale="jac",
            max_nfev=100,
        )
        for start in starts
    ]
    return np.asarray(min(ends, key=lambda end: float(end.cost)).x)
