"""Sampling of posteriors with emcee, as long as its autocorrelation asks.

A proposal law, the Gaussian approximation at the maximum with heavier tails, is drawn from and
weighed by the posterior (importance sampling; Rubin 1988). Walkers start at points resampled by
these weights, so that they have little to forget, and mostly propose anew, in equal parts from that
law and from a Student law about the weighed points (independence proposals, nearly uncorrelated
where the posterior is nearly Gaussian); every tenth step is a stretch move (Goodman & Weare 2010),
which does not need that to be so. Where the weights rest on few points the Student law is that of
the chain's first steps instead. The chain grows until it holds enough independent samples and each
walker's part is many autocorrelation times long; whether it got there is part of the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import special

from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray

STUDENT_DEGREES = 5.0
REFINED_WIDENING = 1.2
# Points of the proposal that are weighed, and the least effective number of posterior samples that
# they must be worth.
WEIGHED, LEAST_WORTH = 512, 64
STRETCHED = 0.1
STEPS_AT_ONCE = 10
# Steps discarded at the start of the chain: usually, and where the weighed points were worth too
# little; at least this share of the chain.
BURN_IN, BURN_IN_FROM_AFAR, BURN_IN_SHARE = 10, 100, 0.2
# Least length of the chain in autocorrelation times, and least independent samples of all walkers.
AUTOCORRELATION_TIMES = 10
EFFECTIVE_SAMPLES = 800
R_HAT_LIMIT = 1.05
HALVINGS = 60


class Proposal(Protocol):
    """Where walkers are proposed to go."""

    def draw(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, dimensions) points."""

    def log_density(self, points: FloatArray) -> FloatArray:
        """(n,) up to a constant."""


@dataclass(frozen=True)
class Chain:
    """A sample and its convergence.

    Attributes
    ----------
    theta : (n_samples, dimensions).
    r_hat : largest split R-hat over the coordinates (Gelman et al. 2013, section 11.4).
    effective_samples : smallest number of independent samples over the coordinates.
    converged : at least 10 autocorrelation times long with 800 independent samples, and R-hat
        below 1.05.
    """

    theta: FloatArray
    r_hat: float
    effective_samples: float
    converged: bool


def sample(
    log_probability: Callable[[FloatArray], FloatArray],
    proposal: Proposal,
    centre: FloatArray,
    generator: np.random.Generator,
    *,
    walkers: int = 32,
    longest: int = 2000,
) -> Chain:
    """Sample a posterior.

    Parameters
    ----------
    log_probability : from (n, dimensions) to (n,); −inf where not allowed.
    proposal : a law that covers the posterior.
    centre : (dimensions,) the maximum, where the posterior is not zero.
    walkers : at least two more than twice the dimensions. longest : steps at most.

    Raises
    ------
    FitError : the priors exclude the maximum.
    """
    import emcee

    weighed = _Weighed.of(log_probability, proposal, generator)
    law: list[Proposal] = [proposal]
    burn_in = BURN_IN
    if weighed.worth < LEAST_WORTH:
        burn_in = BURN_IN_FROM_AFAR
        start = _inside(weighed.points[:walkers], centre, log_probability)
    else:
        start = weighed.resampled(walkers, generator)
        law.append(_Refined.by(proposal, weighed.points, weighed.shares))

    def propose(walkers: FloatArray, random: object) -> tuple[FloatArray, FloatArray]:
        drawn = law[-1].draw(len(walkers), generator)
        return drawn, law[-1].log_density(walkers) - law[-1].log_density(drawn)

    dimensions = len(centre)
    sampler = emcee.EnsembleSampler(
        walkers,
        dimensions,
        log_probability,
        vectorize=True,
        moves=[
            (emcee.moves.MHMove(propose), 1 - STRETCHED),
            (emcee.moves.StretchMove(), STRETCHED),
        ],
    )
    sampler.random_state = np.random.RandomState(generator.integers(2**31)).get_state()
    state, autocorrelation, enough = start, math.inf, False
    while sampler.iteration < longest and not enough:
        state = sampler.run_mcmc(state, STEPS_AT_ONCE, skip_initial_state_check=True)
        if sampler.iteration <= burn_in:
            if len(law) == 1 and sampler.iteration == burn_in:
                flat = sampler.get_chain(discard=burn_in // 2, flat=True)
                law.append(_Refined.by(proposal, flat, np.full(len(flat), 1 / len(flat))))
            continue
        chain = sampler.get_chain(discard=max(burn_in, int(BURN_IN_SHARE * sampler.iteration)))
        # a walker that never moved has no autocorrelation function
        with np.errstate(invalid="ignore", divide="ignore"):
            times = emcee.autocorr.integrated_time(chain, tol=0, quiet=True)
        autocorrelation = float(np.max(times)) if np.all(np.isfinite(times)) else math.inf
        r_hat = float(np.max(split_r_hat(chain)))
        long = len(chain) >= autocorrelation * max(
            AUTOCORRELATION_TIMES, EFFECTIVE_SAMPLES / walkers
        )
        enough = long and r_hat < R_HAT_LIMIT
    flat = chain.reshape(-1, dimensions)
    return Chain(
        theta=flat,
        r_hat=r_hat,
        effective_samples=len(flat) / autocorrelation,
        converged=enough,
    )


@dataclass(frozen=True)
class _Weighed:
    """Points of a proposal and what share of the posterior each stands for (they sum to 1)."""

    points: FloatArray
    shares: FloatArray

    @classmethod
    def of(
        cls,
        log_probability: Callable[[FloatArray], FloatArray],
        proposal: Proposal,
        generator: np.random.Generator,
    ) -> _Weighed:
        points = proposal.draw(WEIGHED, generator)
        log_weight = log_probability(points) - proposal.log_density(points)
        known = np.isfinite(log_weight)
        shares = np.zeros(len(points))
        if known.any():
            shares[known] = np.exp(log_weight[known] - np.max(log_weight[known]))
            shares /= shares.sum()
        return cls(points, shares)

    @property
    def worth(self) -> float:
        """How many draws from the posterior the points are worth (Kong 1992)."""
        squares = float(np.sum(self.shares**2))
        return 1 / squares if squares > 0 else 0.0

    def resampled(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, dimensions) points by their shares, in even steps (systematic resampling)."""
        at = (np.arange(n) + generator.random()) / n
        chosen = np.searchsorted(np.cumsum(self.shares), at)
        return self.points[np.minimum(chosen, len(self.points) - 1)]


@dataclass(frozen=True)
class _Refined:
    """Mixture, half and half, of an earlier proposal and a Student law around a sample."""

    before: Proposal
    sampled: Student

    @classmethod
    def by(cls, before: Proposal, points: FloatArray, shares: FloatArray) -> _Refined:
        """For points (n, dimensions) of which each stands for a share (n,) of the posterior."""
        centre = shares @ points
        covariance = np.atleast_2d(np.cov(points.T, aweights=shares, bias=True))
        covariance = covariance + 1e-12 * np.eye(len(centre))
        return cls(before, Student.about(centre, covariance, REFINED_WIDENING))

    def draw(self, n: int, generator: np.random.Generator) -> FloatArray:
        chosen = generator.random(n) < 0.5
        return np.where(
            chosen[:, None], self.sampled.draw(n, generator), self.before.draw(n, generator)
        )

    def log_density(self, points: FloatArray) -> FloatArray:
        return np.logaddexp(self.before.log_density(points), self.sampled.log_density(points))


def _inside(
    walkers: FloatArray, centre: FloatArray, log_probability: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Walkers moved towards the maximum until all lie where the prior allows."""
    for _ in range(HALVINGS):
        outside = ~np.isfinite(log_probability(walkers))
        if not outside.any():
            return walkers
        walkers[outside] = 0.5 * (walkers[outside] + centre)
    raise FitError(
        "priors exclude the best fit: stated friction, noise and data contradict one another"
    )


def split_r_hat(chain: FloatArray) -> FloatArray:
    """Split R-hat per coordinate for a chain (n_steps, n_walkers, n_coordinates)."""
    half = len(chain) // 2
    parts = np.concatenate([chain[:half], chain[half : 2 * half]], axis=1)
    within = parts.var(axis=0, ddof=1).mean(axis=0)
    between = parts.mean(axis=0).var(axis=0, ddof=1)
    return np.asarray(np.sqrt((half - 1) / half + between / np.maximum(within, 1e-300)))


@dataclass(frozen=True)
class Student:
    """Multivariate Student law of `STUDENT_DEGREES` degrees of freedom.

    Heavy tails cost little in two or three dimensions.
    """

    centre: FloatArray
    root: FloatArray
    inverse: FloatArray
    log_volume: float

    @classmethod
    def about(cls, centre: FloatArray, covariance: FloatArray, widening: float) -> Student:
        """The law whose scale is the root of a covariance, widened."""
        lower = np.linalg.cholesky(covariance + 1e-12 * np.diag(np.diag(covariance)))
        root = np.asarray(widening * lower, dtype=np.float64)
        inverse = np.asarray(np.linalg.inv(root), dtype=np.float64)
        volume = float(np.sum(np.log(np.diag(root))))
        return cls(np.asarray(centre), root, inverse, volume)

    def draw(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, dimensions) points."""
        normal = generator.normal(size=(n, len(self.centre)))
        tail = np.sqrt(STUDENT_DEGREES / generator.chisquare(STUDENT_DEGREES, size=(n, 1)))
        return np.asarray(self.centre + (normal * tail) @ self.root.T)

    def log_density(self, points: FloatArray) -> FloatArray:
        """(n,)"""
        scaled = (points - self.centre) @ self.inverse.T
        dimensions = len(self.centre)
        power = 0.5 * (STUDENT_DEGREES + dimensions)
        distance = np.sum(scaled**2, axis=1)
        norm = special.gammaln(power) - special.gammaln(0.5 * STUDENT_DEGREES)
        norm -= 0.5 * dimensions * math.log(math.pi * STUDENT_DEGREES) + self.log_volume
        return np.asarray(norm - power * np.log1p(distance / STUDENT_DEGREES))
