"""Posterior of one trace's fit, sampled with emcee (`mtpipe.fit.sampling`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.estimate import Estimate, Status
from mtpipe.fit.sampling import Mixture, Student, sample
from mtpipe.fit.trace import NOT_IDENTIFIED_LN, TraceFit, fit_model, tied
from mtpipe.physics.camera import FloatArray

METHOD = "spectrum, posterior"
TAIL_DEGREES = 5.0
TAIL_WIDENING = 1.3


@dataclass(frozen=True)
class Posterior:
    """Samples of a trace's posterior and their convergence.

    Attributes
    ----------
    theta : (n_samples, 3) in the coordinates of `mtpipe.fit.model`.
    r_hat, effective_samples, converged : as of `mtpipe.fit.sampling.Chain`.
    """

    theta: FloatArray
    r_hat: float
    effective_samples: float
    converged: bool
    fit: TraceFit

    @property
    def stiffness_pN_per_nm(self) -> FloatArray:
        """(n_samples,)"""
        return np.asarray(np.exp(self.theta[:, 0]))

    @property
    def friction_pN_s_per_nm(self) -> FloatArray:
        """(n_samples,)"""
        return np.asarray(np.exp(self.theta[:, 1]))

    @property
    def noise_nm(self) -> FloatArray:
        """(n_samples,)"""
        return np.asarray(np.sqrt(self.fit.model.noise_nm2(self.theta)))

    @property
    def stiffness(self) -> Estimate:
        """Stiffness in pN/nm."""
        return self.summary(self.stiffness_pN_per_nm, "pN/nm")

    @property
    def friction(self) -> Estimate:
        """Friction in pN s/nm."""
        return self.summary(self.friction_pN_s_per_nm, "pN s/nm")

    @property
    def noise(self) -> Estimate:
        """Tracking noise in nm."""
        if self.fit.model.noise_variance_nm2 is not None:
            return self.fit.noise
        return self.summary(self.noise_nm, "nm", positive=False)

    @property
    def corner_frequency(self) -> Estimate:
        """Corner frequency k/(2πγ) in Hz."""
        corner = np.exp(self.theta[:, 0] - self.theta[:, 1]) / (2 * math.pi)
        return self.summary(corner, "Hz")

    def summary(self, sample: FloatArray, unit: str, *, positive: bool = True) -> Estimate:
        """Median, standard deviation and central 68 % interval of a derived quantity.

        `positive`: a scale, called not identified where it is not known to a factor e.
        """
        low, middle, high = np.quantile(sample, [0.1587, 0.5, 0.8413])
        interval = (float(low), float(high))
        if positive and 0.5 * math.log(high / low) > NOT_IDENTIFIED_LN:
            together = tied(np.cov(self.theta.T), self.fit.model.free)
            return Estimate.missing(unit, METHOD, interval=interval, tied_to=together)
        status: Status = "ok" if self.converged else "not_converged"
        return Estimate(float(middle), float(np.std(sample)), interval, unit, METHOD, status)


def sample_posterior(fit: TraceFit, *, seed: int | np.random.Generator = 0) -> Posterior:
    """Sample the posterior of a fitted trace with emcee.

    Parameters
    ----------
    fit : result of `fit_trace`; its model carries the priors.
    seed : seed or generator; the same seed gives the same chain.
    """
    generator = np.random.default_rng(seed)
    free = list(fit.model.free)

    def log_probability(free_theta: FloatArray) -> FloatArray:
        theta = np.tile(fit.theta, (len(free_theta), 1))
        theta[:, free] = free_theta
        return fit.model.log_posterior(theta)

    chain = sample(log_probability, _proposal(fit), fit.theta[free], generator)
    theta = np.tile(fit.theta, (len(chain.theta), 1))
    theta[:, free] = chain.theta
    return Posterior(theta, chain.r_hat, chain.effective_samples, chain.converged, fit)


def _proposal(fit: TraceFit) -> Mixture | _Folded:
    """Where walkers are proposed to go.

    A Student law about the maximum. Where noise has a prior, an equal share of a second one holds
    what the prior alone says of it, with stiffness and friction as they are then: the posterior has
    a shoulder there. A noise variance is folded to stay positive.
    """
    free = fit.model.free
    log = fit.model.noise_is_log
    covariance = fit.covariance[np.ix_(free, free)]
    # where the data say nothing the Gaussian approximation is no guide: keep it within reason
    size = np.sqrt(np.diag(covariance))
    limit = np.array([3.0, 3.0, 3.0 if log else fit.model.spectrum.variance_nm2])[: len(size)]
    shrink = np.minimum(1.0, limit / size)
    main = _student(fit.theta[list(free)], covariance * np.outer(shrink, shrink))
    if log and fit.model.noise_prior_nm is not None:
        median, factor = fit.model.noise_prior_nm
        usual = fit_model(replace(fit.model, noise_variance_nm2=median**2))
        centre = np.append(usual.theta[:2], 2 * math.log(median))
        covariance = np.zeros((3, 3))
        covariance[:2, :2] = usual.covariance[:2, :2] * np.outer(shrink[:2], shrink[:2])
        covariance[2, 2] = (2 * math.log(factor)) ** 2
        return Mixture((main, _student(centre, covariance)), (0.5, 0.5))
    return _Folded(main) if len(free) == 3 else Mixture((main,), (1.0,))


def _student(centre: FloatArray, covariance: FloatArray) -> Student:
    return Student.about(centre, covariance, degrees=TAIL_DEGREES, widening=TAIL_WIDENING)


@dataclass(frozen=True)
class _Folded:
    """A Student law whose last coordinate, a noise variance, is folded to stay positive."""

    law: Student

    def draw(self, n: int, generator: np.random.Generator) -> FloatArray:
        drawn = self.law.draw(n, generator)
        drawn[:, 2] = np.abs(drawn[:, 2])
        return drawn

    def log_density(self, points: FloatArray) -> FloatArray:
        mirrored = points * np.array([1.0, 1.0, -1.0])
        return np.logaddexp(self.law.log_density(points), self.law.log_density(mirrored))
