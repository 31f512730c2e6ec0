"""Joint fit of one bead's whole series and its posterior (`mtpipe.fit.series_model` says of what).

lmfit maximises the likelihood × prior, emcee samples it. Each trace's own stiffness, friction and
noise are read off as a `TraceFit` and a `Posterior`, as if it had been fitted by itself.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.fit.estimates import inverse_information, logarithmic
from mtpipe.fit.model import PRIOR_HALF_WIDTH, TraceModel
from mtpipe.fit.series_model import SeriesModel, SeriesTrace
from mtpipe.fit.trace import TraceFit, describe
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.types import FloatArray
from mtpipe.physics.modes import Modes

METHOD = "series of spectra, maximum likelihood"


@dataclass(frozen=True)
class SeriesFit:
    """Maximum of the likelihood × prior of a series.

    Attributes
    ----------
    theta, covariance : (dimensions,), (dimensions, dimensions), in the model's coordinates; the
        covariance is the inverse of the expected information, priors included.
    deviances : (traces,) each trace's own deviance.
    converged : whether lmfit found the maximum.
    """

    model: SeriesModel
    theta: FloatArray
    covariance: FloatArray
    deviances: FloatArray
    converged: bool

    @property
    def total_deviance(self) -> float:
        """Deviance of all traces and priors, −2 ln of likelihood × prior up to a constant."""
        return float(np.sum(self.model.residuals(self.theta[None]) ** 2))

    @property
    def radius(self) -> Estimate:
        """The bead's radius in nm."""
        value, stderr = self.model.bead.radius_nm
        if not self.model.radius_free:
            interval = (value - stderr, value + stderr)
            return Estimate(value, stderr, interval, "nm", METHOD, "fixed")
        return self._exponential(self.model.ln_radius, "nm")

    @property
    def friction_scale(self) -> Estimate:
        """Friction over that expected from the fitted radius, the viscosity and the height."""
        return self._exponential(self.model.friction_scale, "")

    def _exponential(self, i: int, unit: str) -> Estimate:
        return logarithmic(self.theta[i], self.covariance[i, i], unit, METHOD)

    def trace_fit(self, trace: SeriesTrace) -> TraceFit:
        """One trace's stiffness, friction and noise as fitted to the whole series."""
        coordinates = self.model.coordinates(self.theta[None], trace)[0]
        low, high = self.model.around(self.theta)
        width = np.sum(high - low, axis=1)[:, None]
        slope = (self.model.coordinates(high, trace) - self.model.coordinates(low, trace)) / width
        share = len(self.theta) / len(self.model.traces)
        return describe(
            self._trace_model(trace), coordinates, slope.T @ self.covariance @ slope, fitted=share
        )

    def trace_information(self, trace: SeriesTrace) -> float:
        """How much one trace by itself says of its ln force or ln stiffness, all else given."""
        _, slope = self._slopes[trace]
        return float(slope[0] ** 2 @ trace.model.ordinates)

    @functools.cached_property
    def shift_per_exposure(self) -> FloatArray:
        """(dimensions,) how far θ moves per second by which the exposure is not as it is taken."""
        score = np.zeros(len(self.theta))
        for trace, (mine, slope) in self._slopes.items():
            at = self.model.coordinates(self.theta[None], trace)[0]
            per_exposure = self._trace_model(trace).exposure_slope(at)
            score[mine] += (slope * trace.model.ordinates) @ per_exposure
        return -self.covariance @ score

    @functools.cached_property
    def _slopes(self) -> dict[SeriesTrace, tuple[list[int], FloatArray]]:
        """Per trace, which coordinates move it, and how its ln power follows (at the maximum)."""
        return dict(zip(self.model.traces, self.model.slopes(self.theta), strict=True))

    def _trace_model(self, trace: SeriesTrace) -> TraceModel:
        """A trace's model at the maximum; its noise a fitted variance."""
        modes = self.model.modes(self.theta[None], trace)
        here = Modes(
            tuple(float(np.squeeze(share)) for share in modes.shares),
            tuple(float(np.squeeze(rate)) for rate in modes.rates),
        )
        return replace(
            trace.model, noise_variance_nm2=None, noise_prior_nm=None, friction=None, modes=here
        )


def fit_series(model: SeriesModel) -> SeriesFit:
    """Maximise likelihood × prior of a series with lmfit, from the traces by themselves."""
    import lmfit

    parameters = lmfit.Parameters()
    for i, name in enumerate(model.names):
        value = model.start[i] / model.units[i]
        if model.is_variance(i):
            parameters.add(name, value=max(value, 1e-3), min=0.0)
        else:
            reach = PRIOR_HALF_WIDTH if not name.startswith("noise") else math.inf
            parameters.add(name, value=value, min=value - reach, max=value + reach)

    def coordinates(values: lmfit.Parameters) -> FloatArray:
        return np.array([values[name].value for name in model.names]) * model.units

    result = lmfit.minimize(
        lambda values: model.residuals(coordinates(values)[None])[0],
        parameters,
        method="leastsq",
        Dfun=lambda values: model.jacobian(coordinates(values)) * model.units,
        scale_covar=False,
        ftol=1e-8,
        xtol=1e-8,
    )
    theta = coordinates(result.params)
    deviances = [
        float(np.sum(t.model.deviance_roots(model.expected(theta[None], t)) ** 2))
        for t in model.traces
    ]
    covariance = inverse_information(model.information(theta))
    return SeriesFit(model, theta, covariance, np.array(deviances), bool(result.success))
