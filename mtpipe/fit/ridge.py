"""Where the walkers of a posterior with tracking noise are proposed to go.

Noise and stiffness trade along a ridge that is no straight line: beyond the Nyquist frequency both
only show as a level of the spectrum. So the noise is drawn first, as a variance, in which the
likelihood is nearly Gaussian down to zero, or from its prior; all else follows from its Gaussian
approximation about where it is likeliest given that noise.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from mtpipe.fit.model import LARGEST_LN_NOISE
from mtpipe.fit.sampling import Student
from mtpipe.ground.types import FloatArray

NOISE_WIDENING = 1.25
REST_WIDENING = 1.3
TOGETHER_SHARE = 0.5
# Largest standard error of ln ε² by the data alone.
WIDEST_LN = 8.0
# Standard errors of the noise variance above its maximum up to which the likeliest values of the
# other parameters are followed, from zero noise on.
RIDGE_SIGMAS = 4.0
RIDGE_ITERATIONS = 2
SMALLEST_RATIO = 0.01


@dataclass(frozen=True)
class NoiseCoordinate:
    """A coordinate that is a tracking noise: ε² itself, or its logarithm with a prior.

    `prior_nm`: median and the factor that holds 68 %, for the logarithm; None: ε² with a flat one.
    """

    index: int
    prior_nm: tuple[float, float] | None

    def variance(self, values: FloatArray) -> FloatArray:
        """ε² in nm²."""
        return values if self.prior_nm is None else np.exp(np.minimum(values, LARGEST_LN_NOISE))

    def coordinate(self, variance: float) -> float:
        """The coordinate of an ε²."""
        return variance if self.prior_nm is None else math.log(variance)


def log_matching_prior(
    values: FloatArray, centre: float, stderr: float, factor: float
) -> FloatArray:
    """ln of the prior of ln ε², beside the Gaussian that knowing ε within a factor is.

    Jeffreys's prior of the whole experiment, data and prior knowledge together: where the data tell
    the noise it is flat in ε², in which they are Gaussian; where only the prior does, flat in
    ln ε². Without it long left tails of ln ε² would pull the force down by half an error.

    Parameters
    ----------
    values : (n,) ln ε². centre, stderr : the fit's, prior knowledge included.
    factor : 68 % of the prior lie within.
    """
    of_prior = (2 * math.log(factor)) ** -2
    of_data = max(stderr**-2 - of_prior, 0.0)
    ratio = np.exp(2 * np.clip(values - centre, -LARGEST_LN_NOISE, LARGEST_LN_NOISE))
    return np.asarray(0.5 * np.log(ratio * of_data + of_prior))


@dataclass(frozen=True)
class RidgeProposal:
    """A law of all coordinates: that of the noise, and of all else given the noise."""

    noise: tuple[NoiseCoordinate, ...]
    noise_law: _NoiseLaw | None
    others: list[int]
    rest: Student
    ridges: tuple[CubicSpline, ...]

    @classmethod
    def at(
        cls,
        theta: FloatArray,
        covariance: FloatArray,
        noise: Sequence[NoiseCoordinate],
        ridges: Sequence[CubicSpline],
    ) -> RidgeProposal:
        """About a maximum.

        Parameters
        ----------
        theta, covariance : (d,), (d, d) maximum and Gaussian approximation.
        ridges : for each noise, how far all else moves with its variance (`follow_ridge`).
        """
        chosen = [one.index for one in noise]
        others = [i for i in range(len(theta)) if i not in chosen]
        of_rest, noise_law = covariance[np.ix_(others, others)], None
        if noise:
            of_noise = covariance[np.ix_(chosen, chosen)]
            across = covariance[np.ix_(others, chosen)]
            of_rest = of_rest - across @ np.linalg.solve(of_noise, across.T)
            noise_law = _NoiseLaw.at(theta[chosen], of_noise, noise)
        rest = Student.about(theta[others], of_rest, REST_WIDENING)
        return cls(tuple(noise), noise_law, others, rest, tuple(ridges))

    def draw(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, d) points."""
        drawn = np.empty((n, len(self.noise) + len(self.others)))
        if self.noise_law is not None:
            drawn[:, [one.index for one in self.noise]] = self.noise_law.draw(n, generator)
        drawn[:, self.others] = self.rest.draw(n, generator) + self._moved(drawn)
        return drawn

    def log_density(self, points: FloatArray) -> FloatArray:
        """(n,) up to a constant."""
        density = self.rest.log_density(points[:, self.others] - self._moved(points))
        if self.noise_law is not None:
            chosen = [one.index for one in self.noise]
            density = density + self.noise_law.log_density(points[:, chosen])
        return density

    def _moved(self, points: FloatArray) -> FloatArray:
        """How far the noise moves all else."""
        moved = np.zeros((len(points), len(self.others)))
        for one, ridge in zip(self.noise, self.ridges, strict=True):
            moved += ridge(np.clip(one.variance(points[:, one.index]), 0.0, ridge.x[-1]))
        return moved


@dataclass(frozen=True)
class _NoiseLaw:
    """The variances are Student, folded to be positive, all together or each axis by itself.

    By itself the noise of an axis with a prior is in equal parts of that prior.
    """

    noise: tuple[NoiseCoordinate, ...]
    variances: Student
    alone: tuple[Student, ...]
    priors: tuple[Student | None, ...]

    @classmethod
    def at(
        cls, centre: FloatArray, covariance: FloatArray, noise: Sequence[NoiseCoordinate]
    ) -> _NoiseLaw:
        variance = np.array([
            float(one.variance(np.array(c))) for one, c in zip(noise, centre, strict=True)
        ])  # fmt: skip
        unit = np.array([
            1.0 if one.prior_nm is None else v * _without_prior(stderr, one.prior_nm[1])
            for one, v, stderr in zip(noise, variance, np.sqrt(np.diag(covariance)), strict=True)
        ])  # fmt: skip
        scaled = covariance * np.outer(unit, unit)
        alone = tuple(
            Student.about(variance[i : i + 1], scaled[i : i + 1, i : i + 1], NOISE_WIDENING)
            for i in range(len(noise))
        )
        priors = tuple(
            None
            if one.prior_nm is None
            else Student.about(
                np.array([2 * math.log(one.prior_nm[0])]),
                np.array([[(2 * math.log(one.prior_nm[1])) ** 2]]),
                1.0,
            )
            for one in noise
        )
        together = Student.about(variance, scaled, NOISE_WIDENING)
        return cls(tuple(noise), together, alone, priors)

    def draw(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, noises) coordinates."""
        together = np.abs(self.variances.draw(n, generator))
        for column, one in enumerate(self.noise):
            if one.prior_nm is not None:
                together[:, column] = np.log(together[:, column])
        apart = np.column_stack([self._draw_one(column, n, generator) for column in self._columns])
        chosen = generator.random(n) < TOGETHER_SHARE
        return np.where(chosen[:, None], together, apart)

    def log_density(self, points: FloatArray) -> FloatArray:
        """(n,) up to a constant."""
        variance = np.column_stack([
            one.variance(points[:, column]) for column, one in enumerate(self.noise)
        ])  # fmt: skip
        signs = itertools.product((1.0, -1.0), repeat=variance.shape[1])
        together = np.logaddexp.reduce(
            [self.variances.log_density(variance * np.array(sign)) for sign in signs]
        )
        for column, one in enumerate(self.noise):
            if one.prior_nm is not None:
                together = together + points[:, column]
        apart = np.sum([self._log_density_of_one(c, points[:, c]) for c in self._columns], axis=0)
        return np.asarray(
            np.logaddexp(math.log(TOGETHER_SHARE) + together, math.log(1 - TOGETHER_SHARE) + apart)
        )

    @property
    def _columns(self) -> range:
        return range(len(self.noise))

    def _draw_one(self, column: int, n: int, generator: np.random.Generator) -> FloatArray:
        variance = np.abs(self.alone[column].draw(n, generator)[:, 0])
        prior = self.priors[column]
        if prior is None:
            return np.asarray(variance)
        of_prior = prior.draw(n, generator)[:, 0]
        return np.where(generator.random(n) < 0.5, of_prior, np.log(variance))

    def _log_density_of_one(self, column: int, values: FloatArray) -> FloatArray:
        law, prior = self.alone[column], self.priors[column]
        variance = self.noise[column].variance(values)[:, None]
        density = np.logaddexp(law.log_density(variance), law.log_density(-variance))
        if prior is None:
            return np.asarray(density)
        return np.asarray(
            np.logaddexp(density + values, prior.log_density(values[:, None])) - math.log(2)
        )


def _without_prior(stderr: float, factor: float) -> float:
    """How much wider the data alone leave ln ε² than data and prior together do."""
    of_data = max(stderr**-2 - (2 * math.log(factor)) ** -2, WIDEST_LN**-2)
    return float(1 / math.sqrt(of_data) / stderr)


def follow_ridge(
    theta: FloatArray,
    stderr: float,
    noise: NoiseCoordinate,
    others: list[int],
    move: Callable[[FloatArray], FloatArray],
) -> CubicSpline:
    """How far the likeliest values of all else move with a noise variance, from where they are.

    Parameters
    ----------
    theta : (d,) the maximum. stderr : of the noise's coordinate.
    others : indices of all else.
    move : from θ (d,) the step of all else towards its maximum for that noise.
    """
    centre = float(noise.variance(theta[noise.index]))
    width = stderr if noise.prior_nm is None else centre * min(stderr, 1.0)
    highest = centre + RIDGE_SIGMAS * width
    found = {centre: np.zeros(len(others))}
    lower = () if centre < SMALLEST_RATIO * highest else (0.75, 0.5, 0.25, SMALLEST_RATIO)
    for values in (centre * np.array(lower), np.linspace(centre, highest, 6)[1:]):
        moved = theta.copy()
        for value in values:
            moved[noise.index] = noise.coordinate(float(value))
            for _ in range(RIDGE_ITERATIONS):
                moved[others] += np.clip(move(moved), -1.0, 1.0)
            found[float(value)] = moved[others] - theta[others]
    nodes = sorted(found)
    return CubicSpline(nodes, np.array([found[node] for node in nodes]))
