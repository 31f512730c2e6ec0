"""Posterior of one trace's fit, sampled with emcee.

Walkers start from the Gaussian approximation at the maximum and mostly propose from a heavy-tailed
version of it (independence proposals, nearly uncorrelated where the posterior is nearly Gaussian);
about every fifth step is a stretch move (Goodman & Weare 2010), which does not need that to be so.
The chain grows until it is 50 autocorrelation times long; whether it got there is part of the
result.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtpipe.errors import FitError
from mtpipe.estimate import Estimate, Status
from mtpipe.fit.trace import NOT_IDENTIFIED_LN, TraceFit, fit_model
from mtpipe.physics.camera import FloatArray

METHOD = "spectrum, posterior"
WALKERS = 32
STEPS_AT_ONCE = 100
LONGEST_CHAIN = 1000
AUTOCORRELATION_TIMES = 50
R_HAT_LIMIT = 1.05
TAIL_DEGREES = 5.0
TAIL_WIDENING = 1.3
HALVINGS = 60


@dataclass(frozen=True)
class Posterior:
    """Samples of a trace's posterior and their convergence.

    Attributes
    ----------
    theta : (n_samples, 3) in the coordinates of `mtpipe.fit.model`.
    r_hat : largest split R-hat over the sampled coordinates (Gelman et al. 2013, section 11.4).
    effective_samples : smallest number of independent samples over the coordinates.
    autocorrelation_steps : longest integrated autocorrelation time.
    converged : chain of at least 50 autocorrelation times and R-hat below 1.05.
    """

    theta: FloatArray
    r_hat: float
    effective_samples: float
    autocorrelation_steps: float
    acceptance: float
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

        `positive`: a scale, called not identified where it is not known to a factor e^(±0.5).
        """
        low, middle, high = np.quantile(sample, [0.1587, 0.5, 0.8413])
        interval = (float(low), float(high))
        if positive and 0.5 * math.log(high / low) > NOT_IDENTIFIED_LN:
            return Estimate(math.nan, math.nan, interval, unit, METHOD, "not_identified")
        status: Status = "ok" if self.converged else "not_converged"
        return Estimate(float(middle), float(np.std(sample)), interval, unit, METHOD, status)


def sample_posterior(fit: TraceFit, *, seed: int | np.random.Generator = 0) -> Posterior:
    """Sample the posterior of a fitted trace with emcee.

    Parameters
    ----------
    fit : result of `fit_trace`; its model carries the priors.
    seed : seed or generator; the same seed gives the same chain.
    """
    import emcee

    generator = np.random.default_rng(seed)
    free = list(fit.model.free)
    proposal = _Proposal.at(fit)
    start = proposal.draw(WALKERS, generator)

    def log_probability(free_theta: FloatArray) -> FloatArray:
        theta = np.tile(fit.theta, (len(free_theta), 1))
        theta[:, free] = free_theta
        return fit.model.log_posterior(theta)

    def propose(walkers: FloatArray, random: object) -> tuple[FloatArray, FloatArray]:
        drawn = proposal.draw(len(walkers), generator)
        return drawn, proposal.log_density(walkers) - proposal.log_density(drawn)

    sampler = emcee.EnsembleSampler(
        WALKERS,
        len(free),
        log_probability,
        vectorize=True,
        moves=[(emcee.moves.MHMove(propose), 0.8), (emcee.moves.StretchMove(), 0.2)],
    )
    sampler.random_state = np.random.RandomState(generator.integers(2**31)).get_state()
    state, autocorrelation, enough = (
        _inside(start, fit.theta[free], log_probability),
        math.inf,
        False,
    )
    while sampler.iteration < LONGEST_CHAIN and not enough:
        state = sampler.run_mcmc(state, STEPS_AT_ONCE, skip_initial_state_check=True)
        chain = sampler.get_chain(discard=_burn_in(sampler.iteration))
        # a walker that never moved has no autocorrelation function
        with np.errstate(invalid="ignore", divide="ignore"):
            times = emcee.autocorr.integrated_time(chain, tol=0, quiet=True)
        autocorrelation = float(np.max(times)) if np.all(np.isfinite(times)) else math.inf
        enough = len(chain) >= AUTOCORRELATION_TIMES * autocorrelation
    r_hat = float(np.max(_split_r_hat(chain)))
    flat = chain.reshape(-1, len(free))
    theta = np.tile(fit.theta, (len(flat), 1))
    theta[:, free] = flat
    return Posterior(
        theta=theta,
        r_hat=r_hat,
        effective_samples=len(flat) / autocorrelation,
        autocorrelation_steps=autocorrelation,
        acceptance=float(np.mean(sampler.acceptance_fraction)),
        converged=bool(enough and r_hat < R_HAT_LIMIT),
        fit=fit,
    )


def _inside(
    walkers: FloatArray, centre: FloatArray, log_probability: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Walkers moved towards the maximum until all lie where the prior allows."""
    for _ in range(HALVINGS):
        outside = ~np.isfinite(log_probability(walkers))
        if not outside.any():
            return walkers
        walkers[outside] = 0.5 * (walkers[outside] + centre)
    raise FitError("the priors exclude the best fit: stated friction, noise and data contradict")


def _burn_in(steps: int) -> int:
    return steps // 5


def _split_r_hat(chain: NDArray[np.float64]) -> FloatArray:
    """Split R-hat per coordinate for a chain (n_steps, n_walkers, n_coordinates)."""
    half = len(chain) // 2
    parts = np.concatenate([chain[:half], chain[half : 2 * half]], axis=1)
    within = parts.var(axis=0, ddof=1).mean(axis=0)
    between = parts.mean(axis=0).var(axis=0, ddof=1)
    return np.asarray(np.sqrt((half - 1) / half + between / np.maximum(within, 1e-300)))


@dataclass(frozen=True)
class _Student:
    """Multivariate Student law, up to a constant that all share with the same dimension."""

    centre: FloatArray
    root: FloatArray
    inverse: FloatArray
    log_volume: float

    @classmethod
    def about(cls, centre: FloatArray, covariance: FloatArray) -> _Student:
        lower = np.linalg.cholesky(covariance + 1e-12 * np.diag(np.diag(covariance)))
        root = np.asarray(TAIL_WIDENING * lower, dtype=np.float64)
        inverse = np.asarray(np.linalg.inv(root), dtype=np.float64)
        return cls(np.asarray(centre), root, inverse, float(np.sum(np.log(np.diag(root)))))

    def draw(self, n: int, generator: np.random.Generator) -> FloatArray:
        normal = generator.normal(size=(n, len(self.centre)))
        tail = np.sqrt(TAIL_DEGREES / generator.chisquare(TAIL_DEGREES, size=(n, 1)))
        return np.asarray(self.centre + (normal * tail) @ self.root.T)

    def log_density(self, points: FloatArray) -> FloatArray:
        scaled = (points - self.centre) @ self.inverse.T
        power = -0.5 * (TAIL_DEGREES + len(self.centre))
        distance = np.sum(scaled**2, axis=1)
        return np.asarray(power * np.log1p(distance / TAIL_DEGREES) - self.log_volume)


@dataclass(frozen=True)
class _Proposal:
    """Where walkers are proposed to go: an equal mixture of Student laws.

    One lies about the maximum. Where noise has a prior, a second one holds what the prior alone
    says of it, with stiffness and friction as they are then: the posterior has a shoulder there.
    A noise variance is folded to stay positive.
    """

    parts: tuple[_Student, ...]
    folded: bool

    @classmethod
    def at(cls, fit: TraceFit) -> _Proposal:
        free = fit.model.free
        log = fit.model.noise_is_log
        covariance = fit.covariance[np.ix_(free, free)]
        # where the data say nothing the Gaussian approximation is no guide: keep it within reason
        size = np.sqrt(np.diag(covariance))
        limit = np.array([3.0, 3.0, 3.0 if log else fit.model.spectrum.variance_nm2])[: len(size)]
        shrink = np.minimum(1.0, limit / size)
        main = _Student.about(fit.theta[list(free)], covariance * np.outer(shrink, shrink))
        if not log or fit.model.noise_prior_nm is None:
            return cls((main,), folded=len(free) == 3)
        median, factor = fit.model.noise_prior_nm
        usual = fit_model(replace(fit.model, noise_variance_nm2=median**2))
        centre = np.append(usual.theta[:2], 2 * math.log(median))
        covariance = np.zeros((3, 3))
        covariance[:2, :2] = usual.covariance[:2, :2] * np.outer(shrink[:2], shrink[:2])
        covariance[2, 2] = (2 * math.log(factor)) ** 2
        return cls((main, _Student.about(centre, covariance)), folded=False)

    def draw(self, n: int, generator: np.random.Generator) -> FloatArray:
        drawn = np.stack([part.draw(n, generator) for part in self.parts])
        chosen = drawn[generator.integers(len(self.parts), size=n), np.arange(n)]
        if self.folded:
            chosen[:, 2] = np.abs(chosen[:, 2])
        return np.asarray(chosen)

    def log_density(self, points: FloatArray) -> FloatArray:
        density = self.parts[0].log_density(points)
        for part in self.parts[1:]:
            density = np.logaddexp(density, part.log_density(points))
        if self.folded:
            mirrored = points * np.array([1.0, 1.0, -1.0])
            density = np.logaddexp(density, self.parts[0].log_density(mirrored))
        return density
