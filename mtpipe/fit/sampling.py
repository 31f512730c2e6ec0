"""Sampling of posteriors with emcee, until the chain is long enough or a limit is reached.

Walkers start from a proposal law, the Gaussian approximation at the maximum with heavier tails, and
mostly propose from it anew (independence proposals, nearly uncorrelated where the posterior is
nearly Gaussian); about every fifth step is a stretch move (Goodman & Weare 2010), which does not
need that to be so. After the first steps, which are discarded, half of the proposals come from a
Student law about the sample so far. The chain grows until it is 50 autocorrelation times long;
whether it got there is part of the result.
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
STEPS_AT_ONCE = 100
AUTOCORRELATION_TIMES = 50
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
    converged : chain of at least 50 autocorrelation times and R-hat below 1.05.
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

    law: list[Proposal] = [proposal]

    def propose(walkers: FloatArray, random: object) -> tuple[FloatArray, FloatArray]:
        drawn = law[-1].draw(len(walkers), generator)
        return drawn, law[-1].log_density(walkers) - law[-1].log_density(drawn)

    dimensions = len(centre)
    sampler = emcee.EnsembleSampler(
        walkers,
        dimensions,
        log_probability,
        vectorize=True,
        moves=[(emcee.moves.MHMove(propose), 0.8), (emcee.moves.StretchMove(), 0.2)],
    )
    start = proposal.draw(walkers, generator)
    sampler.random_state = np.random.RandomState(generator.integers(2**31)).get_state()
    state = _inside(start, centre, log_probability)
    autocorrelation, enough = math.inf, False
    while sampler.iteration < longest and not enough:
        state = sampler.run_mcmc(state, STEPS_AT_ONCE, skip_initial_state_check=True)
        if len(law) == 1:
            law.append(_Refined.by(proposal, sampler.get_chain(discard=STEPS_AT_ONCE // 2)))
            continue
        chain = sampler.get_chain(discard=max(STEPS_AT_ONCE, sampler.iteration // 5))
        # a walker that never moved has no autocorrelation function
        with np.errstate(invalid="ignore", divide="ignore"):
            times = emcee.autocorr.integrated_time(chain, tol=0, quiet=True)
        autocorrelation = float(np.max(times)) if np.all(np.isfinite(times)) else math.inf
        r_hat = float(np.max(split_r_hat(chain)))
        long = len(chain) >= AUTOCORRELATION_TIMES * autocorrelation
        enough = long and r_hat < R_HAT_LIMIT
    flat = chain.reshape(-1, dimensions)
    return Chain(
        theta=flat,
        r_hat=r_hat,
        effective_samples=len(flat) / autocorrelation,
        converged=enough,
    )


@dataclass(frozen=True)
class _Refined:
    """In equal parts the proposal so far and a Student law about a sample."""

    before: Proposal
    sampled: Student

    @classmethod
    def by(cls, before: Proposal, chain: FloatArray) -> _Refined:
        """For a chain (n_steps, n_walkers, dimensions)."""
        flat = chain.reshape(-1, chain.shape[-1])
        covariance = np.atleast_2d(np.cov(flat.T)) + 1e-12 * np.eye(flat.shape[1])
        return cls(before, Student.about(flat.mean(axis=0), covariance, REFINED_WIDENING))

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
