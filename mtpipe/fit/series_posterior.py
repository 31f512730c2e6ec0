"""Posterior of a bead's series.

Given what the traces share (radius, friction scale, noise) the forces of the plateaus are
independent. So only what is shared is sampled, with emcee, each force integrated out about where it
is likeliest (Laplace; Tierney & Kadane 1986); then each force is drawn from its own exact law given
the shared values. The number of plateaus does not make the sampling harder.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from mtpipe.fit.posterior import Posterior
from mtpipe.fit.ridge import (
    NoiseCoordinate,
    RidgeProposal,
    follow_ridge,
    log_matching_prior,
)
from mtpipe.fit.sampling import Chain, sample
from mtpipe.fit.series import SeriesFit
from mtpipe.fit.series_model import SeriesTrace
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.types import FloatArray
from mtpipe.physics.modes import Modes

METHOD = "series of spectra, posterior"
LONGEST_CHAIN = 500
DRAWS = 600
# Nodes, in standard errors of a force, at which its posterior is computed; draws are on FINE.
NODES = np.linspace(-5.0, 5.0, 13)
# Below this standard error of ln force the posterior is close to a Gaussian, and fewer nodes do.
SMALL_LN, FEWER_NODES = 0.2, np.linspace(-5.0, 5.0, 7)
FINE = np.linspace(-5.0, 5.0, 401)
LARGEST_STEP = 3.0
SMALLEST_CURVATURE = 0.05
NEWTON_STEPS = 3
FAR = 1.0
# Largest standard error of a logarithm in the proposal: where the data say nothing, the Gaussian
# approximation is no guide.
LARGEST_LN_STDERR = 1.0
# Coordinates of a trace, (n, 3), and its modes.
Motion = tuple[FloatArray, Modes]


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
    def radius(self) -> Estimate | None:
        """The bead's radius in nm; None where it was not fitted."""
        if not self.fit.model.radius_free:
            return None
        radius_nm = self.fit.model.radius_nm(self.chain.theta)
        return Estimate.of_sample(radius_nm, "nm", METHOD, converged=self.chain.converged)


def sample_series(fit: SeriesFit, *, seed: int | np.random.Generator = 0) -> SeriesPosterior:
    """Sample the posterior of a fitted series.

    Raises
    ------
    FitError : the priors exclude the maximum.
    """
    generator = np.random.default_rng(seed)
    forces = _Forces.at(fit)
    common = fit.model.common
    proposal = RidgeProposal.at(
        fit.theta[common],
        forces.covariance[np.ix_(common, common)],
        [replace(one, index=common.index(one.index)) for one in forces.noise],
        [CubicSpline(ridge.x, ridge(ridge.x)[:, forces.is_smooth]) for ridge in forces.ridges],
    )
    chain = sample(
        forces.log_marginal,
        proposal,
        fit.theta[common],
        generator,
        longest=LONGEST_CHAIN,
    )
    kept = chain.theta[np.linspace(0, len(chain.theta) - 1, DRAWS).astype(int)]
    return SeriesPosterior(fit, replace(chain, theta=forces.draw(kept, generator)))


@dataclass(frozen=True)
class _Forces:
    """The law of every force (or stiffness) given the common coordinates.

    Attributes
    ----------
    covariance : (d, d) Gaussian approximation of everything, kept within reason.
    noise : the noise coordinates, one per axis.
    smooth : indices of the other common coordinates.
    ridges : one per noise, how forces and smooth coordinates, in this order, move with its
        variance.
    slope : (forces, smooth) how forces follow the smooth coordinates.
    stderr : (forces,) of ln force, all common coordinates given.
    """

    fit: SeriesFit
    covariance: FloatArray
    noise: tuple[NoiseCoordinate, ...]
    smooth: list[int]
    ridges: tuple[CubicSpline, ...]
    slope: FloatArray
    stderr: FloatArray

    @classmethod
    def at(cls, fit: SeriesFit) -> _Forces:
        """About the maximum of a series."""
        model = fit.model
        limit = np.array([
            unit if model.is_variance(i) else LARGEST_LN_STDERR
            for i, unit in enumerate(model.units)
        ])  # fmt: skip
        sigma = np.sqrt(np.diag(fit.covariance))
        shrink = np.minimum(1.0, limit / sigma)
        noise = tuple(
            NoiseCoordinate(model.noise(axis), model.bead.noise_nm[axis]) for axis in model.axes
        )
        smooth = [i for i in model.common if i not in [one.index for one in noise]]
        moved = [*model.drives, *smooth]
        ridges = tuple(
            follow_ridge(
                fit.theta,
                float(sigma[one.index] * shrink[one.index]),
                one,
                moved,
                lambda theta: _step(fit, theta, moved),
            )
            for one in noise
        )
        information = model.information(fit.theta)
        own = np.diag(information)[model.drives]
        slope = -information[np.ix_(model.drives, smooth)] / own[:, None]
        stderr = np.minimum(1 / np.sqrt(np.maximum(own, 1e-12)), LARGEST_LN_STDERR)
        covariance = fit.covariance * np.outer(shrink, shrink)
        return cls(fit, covariance, noise, smooth, ridges, slope, stderr)

    @functools.cached_property
    def members(self) -> list[list[int]]:
        """Places of each force's traces."""
        drives = [self.fit.model.drive(trace) for trace in self.fit.model.traces]
        return [
            [i for i, one in enumerate(drives) if one == drive] for drive in self.fit.model.drives
        ]

    @property
    def is_smooth(self) -> slice:
        """Where the ridges hold the smooth coordinates; before them, the forces."""
        return slice(len(self.stderr), None)

    def likeliest(self, common: FloatArray) -> FloatArray:
        """(n, forces) about where each ln force is likeliest, for (n, common)."""
        model, centre = self.fit.model, self.fit.theta
        moved = np.zeros((len(common), len(self.stderr) + len(self.smooth)))
        for one, ridge in zip(self.noise, self.ridges, strict=True):
            variance = one.variance(common[:, model.common.index(one.index)])
            moved += ridge(np.clip(variance, 0.0, ridge.x[-1]))
        own = common[:, [model.common.index(i) for i in self.smooth]] - centre[self.smooth]
        beyond = own - moved[:, self.is_smooth]
        forces = moved[:, : len(self.stderr)]
        return np.asarray(centre[model.drives] + forces + beyond @ self.slope.T)

    def log_marginal(self, common: FloatArray) -> FloatArray:
        """(n,) ln posterior of the common coordinates (n, common), forces integrated out."""
        model = self.fit.model
        theta = np.zeros((len(common), len(self.fit.theta)))
        theta[:, model.common] = common
        out = model.log_prior(theta)
        allowed = np.isfinite(out)
        if allowed.any():
            inside = theta[allowed]
            inside[:, model.drives] = self.likeliest(common[allowed])
            motions = model.motions(inside)
            tops = [self._maximum(inside, drive, motions) for drive in model.drives]
            out[allowed] += np.sum(tops, axis=0) + self._matching_prior(inside)
        return out

    def _maximum(self, theta: FloatArray, drive: int, motions: list[Motion]) -> FloatArray:
        """(n,) ln of a force's likelihood integrated out; moves θ to the maximum.

        A force that turns out to be far from where it was taken to be is looked at again.
        """
        top, moved, far = np.zeros(len(theta)), np.zeros(len(theta)), np.arange(len(theta))
        for _ in range(NEWTON_STEPS):
            low, here, high = self._law(drive, motions, far, moved[far], (-1.0, 0.0, 1.0))
            # in standard errors: slope, curvature, and the parabola's top
            slope = (high - low) / 2
            curvature = np.maximum(2 * here - low - high, SMALLEST_CURVATURE)
            step = np.clip(slope / curvature, -LARGEST_STEP, LARGEST_STEP)
            top[far] = here + slope * step - 0.5 * curvature * step**2 - 0.5 * np.log(curvature)
            moved[far] += step
            far = far[np.abs(step) > FAR]
            if not len(far):
                break
        theta[:, drive] += moved * self.stderr[drive]
        return top

    def _matching_prior(self, theta: FloatArray) -> FloatArray:
        out = np.zeros(len(theta))
        for one in self.noise:
            if one.prior_nm is not None:
                i, factor = one.index, one.prior_nm[1]
                stderr = math.sqrt(self.fit.covariance[i, i])
                out += log_matching_prior(theta[:, i], self.fit.theta[i], stderr, factor)
        return out

    def _law(
        self,
        drive: int,
        motions: list[Motion],
        rows: NDArray[np.int64],
        moved: FloatArray,
        steps: Sequence[float],
    ) -> FloatArray:
        """(steps, rows) ln likelihood of a force's traces at steps of the force in standard errors.

        Parameters
        ----------
        moved : (rows,) where the steps begin.
        """
        out = np.zeros((len(steps), len(rows)))
        for i in self.members[drive]:
            at, modes = motions[i][0][rows], motions[i][1].of(rows)
            begin = at[:, 0] + moved * self.stderr[drive]
            for j, step in enumerate(steps):
                at[:, 0] = begin + step * self.stderr[drive]
                out[j] += self.fit.model.traces[i].bare.log_likelihood(at, modes)
        return out

    def draw(self, common: FloatArray, generator: np.random.Generator) -> FloatArray:
        """(n, d) all coordinates for (n, common): each force from its own law given these."""
        model = self.fit.model
        theta = np.zeros((len(common), len(self.fit.theta)))
        theta[:, model.common] = common
        theta[:, model.drives] = self.likeliest(common)
        motions, rows = model.motions(theta), np.arange(len(theta))
        for i in model.drives:
            begin = theta[:, i].copy()
            self._maximum(theta, i, motions)
            moved = (theta[:, i] - begin) / self.stderr[i]
            nodes = FEWER_NODES if self.stderr[i] < SMALL_LN else NODES
            table = self._law(i, motions, rows, moved, nodes.tolist())
            table -= table.max(axis=0)
            law = np.exp(CubicSpline(nodes, table)(FINE))
            cumulative = np.cumsum(law, axis=0)
            at = generator.random(len(common)) * cumulative[-1]
            chosen = np.sum(cumulative < at, axis=0)
            jitter = (generator.random(len(common)) - 0.5) * (FINE[1] - FINE[0])
            theta[:, i] += self.stderr[i] * (FINE[chosen] + jitter)
        return theta


def _step(fit: SeriesFit, theta: FloatArray, moved: list[int]) -> FloatArray:
    """Gauss–Newton step of some coordinates towards the maximum, the others as they are."""
    jacobian = fit.model.jacobian(theta)[:, moved]
    residuals = fit.model.residuals(theta[None])[0]
    return np.asarray(-np.linalg.lstsq(jacobian, residuals, rcond=None)[0])
