"""Fit of stiffness, friction and noise to quadratic statistics, weighted with their covariance.

The weights are those of the model at the solution, found by repeating a generalised least-squares
fit with lmfit until it no longer moves (quasi-likelihood: Wedderburn 1974; Godambe & Heyde 1987).
As the weights do not follow the noise of the data, the estimating equations have expectation zero
at the truth, and the inverse of JᵀΣ⁻¹J is the covariance of the result.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from mtpipe.fit.arguments import TraceArguments
from mtpipe.fit.estimates import fitted_noise, inverse_information, known_noise
from mtpipe.fit.model import PRIOR_HALF_WIDTH
from mtpipe.fit.trace import AT_ZERO
from mtpipe.ground.types import FloatArray
from mtpipe.methods.motion import SeenMotion
from mtpipe.methods.quadratic import QuadraticStatistics
from mtpipe.methods.result import MethodFit, describe

MOST_ROUNDS = 25
# One round takes 15 to 60 calls; more are wasted where no motion fits the trace at all, and the
# next round goes on from there.
MOST_CALLS = 100
# The fit is at rest when a round moves it by less than this share of the standard errors.
AT_REST = 0.01


@dataclass(frozen=True)
class QuasiLikelihood:
    """Statistics of a trace with what is known beforehand.

    Coordinates θ are (ln k, ln γ) and, where the noise is fitted, ε² in nm².
    """

    statistics: QuadraticStatistics
    arguments: TraceArguments

    @property
    def noise_is_free(self) -> bool:
        """Whether ε² is a coordinate."""
        return self.arguments.noise_variance_nm2 is None

    def motion(self, theta: FloatArray) -> SeenMotion:
        """What the camera sees if the truth is θ."""
        known = self.arguments.noise_variance_nm2
        return SeenMotion(
            self.arguments.thermal_energy_pN_nm * math.exp(-theta[0]),
            math.exp(theta[1] - theta[0]),
            self.arguments.camera,
            float(theta[2]) if known is None else known,
        )

    def weights(self, theta: FloatArray) -> FloatArray:
        """(n, n) lower root of the statistics' covariance; that of the prior comes on top."""
        known_positive = np.append(theta[:2], np.maximum(theta[2:], 0.0))
        covariance = self.statistics.covariance(self.motion(known_positive))
        return np.asarray(linalg.cholesky(covariance, lower=True))

    def residuals(self, theta: FloatArray, root: FloatArray) -> FloatArray:
        """Whitened residuals of the statistics, then that of the prior friction if there is one."""
        difference = self.statistics.values - self.statistics.expected(self.motion(theta))
        whitened = linalg.solve_triangular(root, difference, lower=True)
        prior = self.arguments.friction
        if prior is None:
            return np.asarray(whitened)
        return np.append(whitened, (math.exp(theta[1]) - prior[0]) / prior[1])

    def information(self, theta: FloatArray, root: FloatArray) -> FloatArray:
        """JᵀΣ⁻¹J of the free coordinates."""
        steps = 1e-4 * np.array([1.0, 1.0, self.statistics.values[0]])[: len(theta)]
        columns = []
        for i, step in enumerate(steps):
            shift = step * (np.arange(len(theta)) == i)
            change = self.residuals(theta + shift, root) - self.residuals(theta - shift, root)
            columns.append(change / (2 * step))
        jacobian = np.array(columns)
        return np.asarray(jacobian @ jacobian.T)

    def solved(self, start: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
        """Solution θ, its covariance, and whether the rounds came to rest."""
        theta = start[: 3 if self.noise_is_free else 2].copy()
        for _ in range(MOST_ROUNDS):
            root = self.weights(theta)
            before = theta
            theta, found = self._least_squares(theta, root, start)
            covariance = inverse_information(self.information(theta, root))
            if found and np.all(np.abs(theta - before) <= AT_REST * np.sqrt(np.diag(covariance))):
                return theta, covariance, True
        return theta, covariance, False

    def _least_squares(
        self, theta: FloatArray, root: FloatArray, start: FloatArray
    ) -> tuple[FloatArray, bool]:
        """Least squares with fixed weights, and whether lmfit found the minimum."""
        import lmfit

        unit = float(self.statistics.values[0])
        parameters = lmfit.Parameters()
        for i, name in enumerate(("ln_stiffness", "ln_friction")):
            reach = PRIOR_HALF_WIDTH
            parameters.add(name, theta[i], min=start[i] - reach, max=start[i] + reach)
        if self.noise_is_free:
            # without a bound, near which steps become short: below zero it is fitted as zero
            parameters.add("noise", theta[2] / unit)

        def coordinates(values: lmfit.Parameters) -> FloatArray:
            return np.array(list(values.valuesdict().values())) * [1.0, 1.0, unit][: len(theta)]

        result = lmfit.minimize(
            lambda values: self.residuals(coordinates(values), root),
            parameters,
            method="leastsq",
            scale_covar=False,
            calc_covar=False,
            max_nfev=MOST_CALLS,
            ftol=1e-9,
            xtol=1e-9,
        )
        return coordinates(result.params), bool(result.success)


def fit_statistics(
    method: str,
    statistics: QuadraticStatistics,
    arguments: TraceArguments,
    start: FloatArray,
    *,
    friction_is_given: bool = False,
    notes: tuple[str, ...] = (),
) -> MethodFit:
    """Estimates from the statistics of one trace.

    Parameters
    ----------
    start : (3,) ln k, ln γ, ε² in nm², roughly.
    friction_is_given : the statistics say nothing of the friction, which stays as it was given.
    """
    model = QuasiLikelihood(statistics, arguments)
    theta, covariance, converged = model.solved(start)
    if not model.noise_is_free:
        noise = known_noise(arguments.noise_variance_nm2 or 0.0, method)
    else:
        if theta[2] < AT_ZERO * statistics.values[0]:
            without = replace(model, arguments=replace(arguments, noise_variance_nm2=0.0))
            theta, _, converged = without.solved(np.append(theta[:2], 0.0))
            theta = np.append(theta, 0.0)
            # the errors are those with the noise unknown: it is near zero, not known to be zero
            covariance = inverse_information(model.information(theta, model.weights(theta)))
        noise = fitted_noise(float(theta[2]), math.sqrt(covariance[2, 2]), method)
    return describe(
        method,
        theta[:2],
        covariance[:2, :2],
        noise,
        duration_s=len(arguments.x_nm) * arguments.camera.frame_s,
        converged=converged,
        friction_is_given=friction_is_given,
        notes=notes,
    )
