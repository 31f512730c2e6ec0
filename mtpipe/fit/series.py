"""Joint fit of one bead's whole series and its posterior (`mtpipe.fit.series_model` says of what).

lmfit maximises the likelihood × prior, emcee samples it. Each trace's own stiffness, friction and
noise are read off as a `TraceFit` and a `Posterior`, as if it had been fitted by itself.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from mtpipe.estimate import Estimate
from mtpipe.fit.model import LARGEST_LN_NOISE, PRIOR_HALF_WIDTH, TraceModel
from mtpipe.fit.posterior import Posterior
from mtpipe.fit.sampling import Chain, Mixture, Student, sample
from mtpipe.fit.series_model import SeriesModel, SeriesTrace
from mtpipe.fit.trace import TraceFit, describe, inverse_information, logarithmic
from mtpipe.physics.camera import FloatArray
from mtpipe.physics.modes import Modes

METHOD = "series of spectra, maximum likelihood"
# Degrees of freedom, widening, share. In ten and more dimensions a heavier or wider law would be
# accepted rarely.
PROPOSAL_LAWS = ((40.0, 1.08, 0.8), (40.0, 1.35, 0.2))
NOISE_DEGREES = 5.0
NOISE_WIDENING = 1.25
PRIOR_SHARE = 0.15
# The likeliest values given the noise are followed from zero noise to so many standard errors.
RIDGE_SIGMAS = 2.5
RIDGE_ITERATIONS = 2


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
    def radius(self) -> Estimate:
        """The bead's radius in nm."""
        value, stderr = self.model.bead.radius_nm
        if not self.model.radius_free:
            status_of_known = Estimate(
                value, stderr, (value - stderr, value + stderr), "nm", METHOD
            )
            return replace(status_of_known, status="fixed")
        return self._exponential("ln_radius", "nm")

    @property
    def friction_scale(self) -> Estimate:
        """Friction over that expected from the fitted radius, the viscosity and the height."""
        return self._exponential("ln_friction_scale", "")

    def _exponential(self, name: str, unit: str) -> Estimate:
        i = self.model.names.index(name)
        return logarithmic(self.theta[i], self.covariance[i, i], unit)

    def trace_fit(self, trace: SeriesTrace) -> TraceFit:
        """One trace's stiffness, friction and noise as the whole series tells them."""
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
        slope = self.model.slopes(self.theta)[self.model.traces.index(trace)]
        return float(slope[self.model.drive(trace)] ** 2 @ trace.model.ordinates)

    def shift_per_exposure(self) -> FloatArray:
        """(dimensions,) how far θ moves per second by which the exposure is not as it is taken."""
        score = np.zeros(len(self.theta))
        for trace, slope in zip(self.model.traces, self.model.slopes(self.theta), strict=True):
            score += (slope * trace.model.ordinates) @ self._exposure_slope(trace)
        return -self.covariance @ score

    def _exposure_slope(self, trace: SeriesTrace) -> FloatArray:
        at = self.model.coordinates(self.theta[None], trace)[0]
        return self._trace_model(trace).exposure_slope(at)

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


def fit_series(model: SeriesModel, start: FloatArray | None = None) -> SeriesFit:
    """Maximise likelihood × prior of a series with lmfit.

    Parameters
    ----------
    start : (dimensions,) coordinates to start from; default: from the traces by themselves.
    """
    import lmfit

    begin = model.start if start is None else start
    parameters = lmfit.Parameters()
    for i, name in enumerate(model.names):
        bounded = model.is_variance(i)
        value = begin[i] / model.units[i]
        if bounded:
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


@dataclass(frozen=True)
class SeriesPosterior:
    """Posterior of a series: a chain in the model's coordinates."""

    fit: SeriesFit
    chain: Chain

    def trace(self, trace: SeriesTrace) -> Posterior:
        """What the chain says of one trace."""
        return Posterior(
            theta=self.fit.model.coordinates(self.chain.theta, trace),
            r_hat=self.chain.r_hat,
            effective_samples=self.chain.effective_samples,
            converged=self.chain.converged,
            fit=self.fit.trace_fit(trace),
        )

    def force_pN(self, trace: SeriesTrace) -> FloatArray:
        """(n_samples,) force on a trace's bead in its plateau, the extension taken as exact."""
        model, theta = self.fit.model, self.chain.theta
        drive = np.exp(theta[:, model.drive(trace)])
        return drive if model.force_shared else drive * model.lever_nm(theta, trace)

    @property
    def radius_nm(self) -> FloatArray:
        """(n_samples,)"""
        return self.fit.model.radius_nm(self.chain.theta)


def sample_series(fit: SeriesFit, *, seed: int | np.random.Generator = 0) -> SeriesPosterior:
    """Sample the posterior of a fitted series with emcee.

    Raises
    ------
    FitError : the priors exclude the maximum.
    """
    chain = sample(
        fit.model.log_posterior, _Proposal.at(fit), fit.theta, np.random.default_rng(seed)
    )
    return SeriesPosterior(fit, chain)


@dataclass(frozen=True)
class _Proposal:
    """Where walkers are proposed to go.

    Noise with a prior is drawn as a variance, in which the likelihood is nearly Gaussian down to
    zero, or from the prior alone; all else from its Gaussian approximation about where it is
    likeliest given that noise. Above the Nyquist frequency that is no straight line.
    """

    noise: list[int]
    others: list[int]
    noise_law: _NoiseLaw | None
    rest: Mixture
    ridges: tuple[CubicSpline, ...]

    @classmethod
    def at(cls, fit: SeriesFit) -> _Proposal:
        model = fit.model
        # beyond its flat priors a coordinate is not to be proposed
        limit = np.array([
            unit if model.is_variance(i) else 2.0 for i, unit in enumerate(model.units)
        ])  # fmt: skip
        shrink = np.minimum(1.0, limit / np.sqrt(np.diag(fit.covariance)))
        covariance = fit.covariance * np.outer(shrink, shrink)
        noise = model.logarithmic_noise
        others = [i for i in range(len(model.names)) if i not in noise]
        of_rest, law = covariance[np.ix_(others, others)], None
        if noise:
            of_noise = covariance[np.ix_(noise, noise)]
            across = covariance[np.ix_(others, noise)]
            of_rest = of_rest - across @ np.linalg.solve(of_noise, across.T)
            law = _NoiseLaw.at(fit, noise, of_noise)
        rest = Mixture(
            tuple(
                Student.about(fit.theta[others], of_rest, degrees=degrees, widening=widening)
                for degrees, widening, _ in PROPOSAL_LAWS
            ),
            tuple(share for _, _, share in PROPOSAL_LAWS),
        )
        return cls(noise, others, law, rest, tuple(_ridge(fit, i, others) for i in noise))

    def draw(self, n: int, generator: np.random.Generator) -> FloatArray:
        drawn = np.empty((n, len(self.noise) + len(self.others)))
        if self.noise_law is not None:
            drawn[:, self.noise] = self.noise_law.draw(n, generator)
        drawn[:, self.others] = self.rest.draw(n, generator) + self._moved(drawn)
        return drawn

    def log_density(self, points: FloatArray) -> FloatArray:
        density = self.rest.log_density(points[:, self.others] - self._moved(points))
        if self.noise_law is not None:
            density = density + self.noise_law.log_density(points[:, self.noise])
        return density

    def _moved(self, points: FloatArray) -> FloatArray:
        """How far the noise moves all else."""
        moved = np.zeros((len(points), len(self.others)))
        for i, ridge in zip(self.noise, self.ridges, strict=True):
            moved += ridge(np.exp(np.minimum(points[:, i], math.log(ridge.x[-1]))))
        return moved


@dataclass(frozen=True)
class _NoiseLaw:
    """Law of ln ε² on each axis: the variances are Student, folded to be positive, or the prior."""

    variances: Student
    prior: Student

    @classmethod
    def at(cls, fit: SeriesFit, noise: list[int], covariance: FloatArray) -> _NoiseLaw:
        """About a fit; the covariance is of ln ε²."""
        model = fit.model
        known = [model.bead.noise_nm[model.axis_of(i)] or (1.0, 1.0) for i in noise]
        centre = np.exp(fit.theta[noise])
        median = np.array([2 * math.log(nm) for nm, _ in known])
        width = np.array([2 * math.log(factor) for _, factor in known])
        return cls(
            Student.about(
                centre,
                covariance * np.outer(centre, centre),
                degrees=NOISE_DEGREES,
                widening=NOISE_WIDENING,
            ),
            Student.about(median, np.diag(width**2), degrees=NOISE_DEGREES, widening=1.0),
        )

    def draw(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, axes) ln ε²."""
        about = np.log(np.abs(self.variances.draw(n, generator)))
        chosen = generator.random(n) < PRIOR_SHARE
        return np.where(chosen[:, None], self.prior.draw(n, generator), about)

    def log_density(self, ln_variance: FloatArray) -> FloatArray:
        """(n,) up to a constant."""
        variance = np.exp(np.minimum(ln_variance, LARGEST_LN_NOISE))
        signs = itertools.product((1.0, -1.0), repeat=variance.shape[1])
        folded = [self.variances.log_density(variance * np.array(sign)) for sign in signs]
        about = np.logaddexp.reduce(folded) + ln_variance.sum(axis=1)
        return np.asarray(
            np.logaddexp(
                math.log(1 - PRIOR_SHARE) + about,
                math.log(PRIOR_SHARE) + self.prior.log_density(ln_variance),
            )
        )


def _ridge(fit: SeriesFit, coordinate: int, others: list[int]) -> CubicSpline:
    """How far the likeliest values of all else move with a noise variance, from where they are."""
    model, centre = fit.model, math.exp(fit.theta[coordinate])
    highest = 1 + RIDGE_SIGMAS * min(math.sqrt(fit.covariance[coordinate, coordinate]), 1.0)
    found = {centre: np.zeros(len(others))}
    for ratios in ((0.75, 0.5, 0.25, 0.01), np.linspace(1, highest, 4)[1:]):
        theta = fit.theta.copy()
        for ratio in ratios:
            theta[coordinate] = math.log(ratio * centre)
            for _ in range(RIDGE_ITERATIONS):
                jacobian = model.jacobian(theta)[:, others]
                residuals = model.residuals(theta[None])[0]
                move = np.linalg.lstsq(jacobian, residuals, rcond=None)[0]
                theta[others] -= np.clip(move, -1.0, 1.0)
            found[ratio * centre] = theta[others] - fit.theta[others]
    nodes = sorted(found)
    return CubicSpline(nodes, np.array([found[node] for node in nodes]))
