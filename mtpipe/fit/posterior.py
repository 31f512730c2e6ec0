"""Posterior of one trace's fit, sampled with emcee (`mtpipe.fit.sampling`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from mtpipe.fit.estimates import NOT_IDENTIFIED_LN, tied
from mtpipe.fit.ridge import (
    NoiseCoordinate,
    RidgeProposal,
    follow_ridge,
    log_matching_prior,
)
from mtpipe.fit.sampling import sample
from mtpipe.fit.trace import TraceFit
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.shown import Shown, estimates_table
from mtpipe.ground.status import status_of
from mtpipe.ground.types import FloatArray

METHOD = "spectrum, posterior"
DERIVATIVE_STEP = 1e-4


@dataclass(frozen=True)
class Posterior(Shown):
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

    def __repr__(self) -> str:
        doubt = "" if self.converged else "; NOT converged"
        return (
            f"Posterior: stiffness {self.stiffness}, friction {self.friction}, noise {self.noise}, "
            f"corner {self.corner_frequency}; {self.effective_samples:.0f} effective samples{doubt}"
        )

    @property
    def table(self) -> pd.DataFrame:
        """A row for each estimate."""
        return estimates_table(self)

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
        return self.restoring(self.stiffness_pN_per_nm, "pN/nm")

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
        return self.restoring(corner, "Hz")

    def restoring(self, sample: FloatArray, unit: str) -> Estimate:
        """What a sample of a stiffness, force or corner frequency says, which may be nought."""
        told = self.summary(sample, unit)
        return replace(told, status=status_of(told, relaxations=self.fit.relaxations))

    def summary(self, sample: FloatArray, unit: str, *, positive: bool = True) -> Estimate:
        """What a sample of this chain says (`Estimate.of_sample`).

        `positive`: a scale, called not identified where it is not known to a factor e.
        """
        told = Estimate.of_sample(sample, unit, METHOD, converged=self.converged)
        low, high = told.interval
        if positive and low > 0 and 0.5 * math.log(high / low) > NOT_IDENTIFIED_LN:
            together = tied(np.cov(self.theta.T), self.fit.model.free)
            return Estimate.missing(unit, METHOD, interval=told.interval, tied_to=together)
        unlike = status_of(told, p_value=self.fit.p_value) if positive else told.status
        return replace(told, status=unlike)


def sample_posterior(fit: TraceFit, *, seed: int | np.random.Generator = 0) -> Posterior:
    """Sample the posterior of a fitted trace with emcee.

    Parameters
    ----------
    fit : result of `fit_trace`; its model carries the priors.
    seed : seed or generator; the same seed gives the same chain.

    Returns
    -------
    The draws and the convergence of their chains; `.stiffness` and the like are estimates (pN, nm,
    s) from them.
    """
    generator = np.random.default_rng(seed)
    free = list(fit.model.free)

    def log_probability(free_theta: FloatArray) -> FloatArray:
        theta = np.tile(fit.theta, (len(free_theta), 1))
        theta[:, free] = free_theta
        value = fit.model.log_posterior(theta)
        if fit.model.noise_is_log and fit.model.noise_prior_nm is not None:
            stderr = math.sqrt(fit.covariance[2, 2])
            factor = fit.model.noise_prior_nm[1]
            value = value + log_matching_prior(theta[:, 2], fit.theta[2], stderr, factor)
        return value

    chain = sample(log_probability, _proposal(fit), fit.theta[free], generator)
    theta = np.tile(fit.theta, (len(chain.theta), 1))
    theta[:, free] = chain.theta
    return Posterior(theta, chain.r_hat, chain.effective_samples, chain.converged, fit)


def _proposal(fit: TraceFit) -> RidgeProposal:
    """A law about the maximum that covers the posterior."""
    model, free = fit.model, list(fit.model.free)
    covariance = fit.covariance[np.ix_(free, free)]
    # where the data say nothing the Gaussian approximation is no guide: keep it within reason
    largest_noise = 3.0 if model.noise_is_log else model.spectrum.variance_nm2
    limit = np.array([3.0, 3.0, largest_noise])[free]
    shrink = np.minimum(1.0, limit / np.sqrt(np.diag(covariance)))
    noise = [NoiseCoordinate(2, model.noise_prior_nm)] if 2 in free else []

    def move(theta: FloatArray) -> FloatArray:
        """Step of stiffness and friction towards their maximum."""
        shift = DERIVATIVE_STEP * np.eye(3)[:2]
        residuals = model.residuals(np.vstack([theta + shift, theta - shift, theta]))
        jacobian = ((residuals[:2] - residuals[2:4]) / (2 * DERIVATIVE_STEP)).T
        return np.asarray(-np.linalg.lstsq(jacobian, residuals[4], rcond=None)[0])

    stderr = math.sqrt(covariance[-1, -1]) * shrink[-1]
    return RidgeProposal.at(
        fit.theta[free],
        covariance * np.outer(shrink, shrink),
        noise,
        [follow_ridge(fit.theta, stderr, one, [0, 1], move) for one in noise],
    )
