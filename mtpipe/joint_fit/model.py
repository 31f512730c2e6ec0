"""Likelihood of a bead's whole recording under one described experiment.

Unknowns are a force per plateau, shared by x, y, z and the extension, and few `Parameter`s of the
experiment: what the setup states with an error or not at all, the tracking noise, and whatever an
effect brings along. A parameter is a change of the description, so that anything an experiment can
be described with can be fitted.

Per bin the power matrix of n ordinates is complex Wishart about its expectation S (Whittle 1953;
Brillinger 1981, theorem 7.2.4), −n (ln det S + tr S⁻¹P), and what a force that changes does to the
height is taken off z before; the mean height is Gaussian about the chain's with the variance that S
has at zero frequency. Where the bead walks off, as effects may have it, the heights of later
plateaus have wandered with it, and their errors are correlated; how far it has gone at the end of a
plateau is in all ordinates at once, and is integrated out (`mtpipe.joint_fit.random_walk`).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from mtpipe.experiment.changed import changed
from mtpipe.experiment.description import Experiment, Rest
from mtpipe.experiment.known_force import KnownForce
from mtpipe.experiment.parameter import Parameter
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.batch_cache import BatchCache
from mtpipe.joint_fit.data import PlateauData
from mtpipe.joint_fit.expectation import (
    Asked,
    Expectation,
    Subtraction,
    answered,
    expectations,
    know_states,
    larger_pN,
)
from mtpipe.joint_fit.height_course import Course
from mtpipe.joint_fit.layers import steady_in_each, steady_of
from mtpipe.joint_fit.random_walk import Walked, power_without, sees_walks, walked

# Size of the cache of descriptions of one model: θ of a fit, and of the step that it tries.
LATEST = 2


@dataclass(frozen=True, eq=False)
class ConfiguredModel:
    """One bead's data and the experiment that is to explain them.

    The coordinates θ are ln force per plateau, then the parameters.

    Attributes
    ----------
    begins_s : when each plateau begins after the moment from which positions are counted; empty:
        one follows the other from there on.
    height_scatter_nm : standard deviation of what else mean heights are off by, each by itself.
    known_forces : per plateau, what the setup knows beforehand; empty where it knows none. Not
        fitted with: forces are compared with them.
    """

    data: tuple[PlateauData, ...]
    experiment: Experiment
    parameters: tuple[Parameter, ...]
    subtraction: Subtraction
    begins_s: tuple[float, ...] = ()
    height_scatter_nm: float = 0.0
    known_forces: tuple[KnownForce | None, ...] = ()

    @property
    def plateaus(self) -> int:
        """Number of plateaus, and of forces in θ."""
        return len(self.data)

    @property
    def ordinates(self) -> float:
        """Number of ordinates of all axes, by whose logarithm a number costs (BIC)."""
        return 3 * sum(float(data.spectrum.ordinates.sum()) for data in self.data)

    @property
    def lower(self) -> FloatArray:
        """Lowest allowed θ."""
        return np.array([-12.0] * self.plateaus + [p.lower for p in self.parameters])

    @property
    def upper(self) -> FloatArray:
        """Highest allowed θ."""
        return np.array([6.0] * self.plateaus + [p.upper for p in self.parameters])

    def described(self, theta: FloatArray) -> Experiment:
        """The experiment at θ."""
        key = theta.tobytes()
        found = self._described.get(key)
        if found is None:
            found = self._changed(self._at_forces(theta), theta, 0)
            self._described.put(key, found)
        return found

    @functools.cached_property
    def _described(self) -> BatchCache[bytes, Experiment]:
        """Cache of the latest descriptions: expectation, heights and slopes at one θ need the same
        one.
        """
        return BatchCache(LATEST)

    def beside(self, theta: FloatArray) -> list[tuple[float, Experiment]]:
        """Pairs, one per parameter: its step away from θ, and the experiment there."""
        found = []
        before = self._at_forces(theta)
        for k, parameter in enumerate(self.parameters):
            value = float(theta[self.plateaus + k])
            step = parameter.step_from(value)
            found.append(
                (step, self._changed(parameter.change(before, value + step), theta, k + 1))
            )
            before = parameter.change(before, value)
        return found

    def _at_forces(self, theta: FloatArray) -> Experiment:
        """The experiment with the forces at θ, its parameters not yet."""
        forces = np.exp(theta[: self.plateaus]).tolist()
        rests = tuple(
            Rest(force_pN, rest.frames, rest.magnet_mm)
            for force_pN, rest in zip(forces, self.experiment.rests, strict=True)
        )
        return changed(self.experiment, rests=rests)

    def _changed(self, experiment: Experiment, theta: FloatArray, first: int) -> Experiment:
        """Experiment with the parameters from index `first` on set to θ; earlier ones are set
        already.
        """
        values = theta[self.plateaus + first :].tolist()
        for parameter, value in zip(self.parameters[first:], values, strict=True):
            experiment = parameter.change(experiment, value)
        return experiment

    def asked(self, experiment: Experiment, plateau: int, force_pN: float) -> Asked:
        """Request for what one plateau's data should be in an experiment, at a force."""
        course = experiment.magnets.course(plateau)
        steady = steady_of(experiment.in_plateau(plateau))
        return Asked(self.data[plateau], steady, course, force_pN)

    def asked_in_each(self, experiment: Experiment, forces_pN: Sequence[float]) -> list[Asked]:
        """The same of all plateaus, each at its force."""
        steady = steady_in_each(experiment, self.plateaus)
        return [
            Asked(data, there, experiment.magnets.course(i), force_pN)
            for i, (data, there, force_pN) in enumerate(
                zip(self.data, steady, forces_pN, strict=True)
            )
        ]

    def expectations(self, those: Sequence[Asked]) -> list[Expectation | FitError]:
        """Expectation for each request, or the error that says why there is none."""
        return expectations(self.subtraction, those)

    def expected(self, experiment: Experiment, plateau: int, force_pN: float) -> Expectation:
        """What one plateau's data should be at a force.

        Raises
        ------
        FitError : the force is too small to keep the bead off the surface.
        """
        return answered(*self.expectations([self.asked(experiment, plateau, force_pN)]))

    def all_expected(self, theta: FloatArray) -> list[Expectation]:
        """What all plateaus' data should be at θ.

        Raises
        ------
        FitError : a force is too small to keep the bead off the surface.
        """
        experiment = self.described(theta)
        # slopes will ask for the second
        forces = [[rest.force_pN, larger_pN(rest.force_pN)] for rest in experiment.rests]
        know_states(self.data, experiment, forces)
        those = self.asked_in_each(experiment, [rest.force_pN for rest in experiment.rests])
        return [answered(one) for one in self.expectations(those)]

    def log_likelihood(self, expected: list[Expectation], theta: FloatArray) -> float:
        """ln likelihood × prior, up to a constant."""
        total = -0.5 * float(np.sum(self.pulls(theta) ** 2))
        for data, model in zip(self.data, expected, strict=True):
            total += spectral_log_likelihood(data, model)
        heights = self.heights(self.data, expected, theta)
        total += float(np.sum(np.log(np.diag(heights.whitening))))
        return total - 0.5 * float(np.sum(heights.pulls**2))

    @functools.cached_property
    def wandering_s(self) -> FloatArray:
        """(plateaus, plateaus) covariance of the mean heights under a random walk of 1 nm/√s."""
        lasts = np.array([data.duration_s for data in self.data])
        begins = np.array(self.begins_s) if self.begins_s else np.cumsum(lasts) - lasts
        middles = begins + lasts / 2
        apart = np.minimum.outer(middles, middles)
        return np.asarray(np.where(np.eye(len(lasts)) > 0, begins + lasts / 3, apart))

    @functools.cached_property
    def moved_by_ends(self) -> FloatArray:
        """(plateaus, plateaus) how mean heights follow the way that a walk goes in each plateau."""
        return np.tri(self.plateaus, k=-1) + np.eye(self.plateaus) / 2

    @functools.cached_property
    def wandering_beside_s(self) -> FloatArray:
        """(plateaus, plateaus) as `wandering_s`, the way in plateaus that see it given."""
        seen_s = np.array([one.duration_s if sees_walks(one) else 0.0 for one in self.data])
        by_ends = (self.moved_by_ends * seen_s) @ self.moved_by_ends.T
        return np.asarray(self.wandering_s - by_ends)

    def walk_nm2_per_s(self, theta: FloatArray) -> float:
        """Square of the random walk of z that subtraction has left, at θ."""
        experiment = self.described(theta) if self.walking else self.experiment
        return _walk_nm2_per_s(experiment)

    @functools.cached_property
    def walking(self) -> tuple[int, ...]:
        """Coordinates that the random walk of z follows."""
        start = np.concatenate([np.zeros(self.plateaus), [p.start for p in self.parameters]])
        here = _walk_nm2_per_s(self.described(start))
        shifted = enumerate(self.beside(start), start=self.plateaus)
        return tuple(k for k, (_, there) in shifted if _walk_nm2_per_s(there) != here)

    def heights(
        self, data: Sequence[PlateauData], expected: Sequence[Expectation], theta: FloatArray
    ) -> Heights:
        """Mean heights beside the expected ones.

        Parameters
        ----------
        data : the model's, or others like them.
        """
        stderr = np.array([one.extension_stderr_nm for one in expected])
        stderr = np.hypot(stderr, self.height_scatter_nm)
        missed = np.array(
            [
                float(one.mean_nm[2]) - here.extension_nm
                for one, here in zip(data, expected, strict=True)
            ]
        )
        ends = [ends_of(one, here) for one, here in zip(data, expected, strict=True)]
        walk, follows = self.walk_nm2_per_s(theta), self.moved_by_ends
        whitening = np.diag(1 / stderr)
        if walk > 0:
            gone = np.array([0.0 if end is None else end.mean_nm[2] for end in ends])
            unknown = np.array([0.0 if end is None else end.covariance_nm2[2, 2] for end in ends])
            missed = missed - follows @ gone
            covariance = np.diag(stderr**2) + walk * self.wandering_beside_s
            root = np.linalg.cholesky(covariance + (follows * unknown) @ follows.T)
            whitening = np.asarray(linalg.solve_triangular(root, np.eye(len(root)), lower=True))
        say = whitening @ follows
        pulls, sharpness = say.T @ (whitening @ missed), np.sum(say**2, axis=0)
        together = [
            None if end is None else end.with_heights(pull, sharp, here.walked_nm2)
            for end, pull, sharp, here in zip(ends, pulls, sharpness, expected, strict=True)
        ]
        return Heights(missed, whitening, together, pulls, sharpness)

    def pulls(self, theta: FloatArray) -> FloatArray:
        """Distances of the parameters from their priors, in standard errors; 0 without one."""
        return np.array(
            [
                0.0 if p.prior is None else (value - p.prior[0]) / p.prior[1]
                for p, value in zip(self.parameters, theta[self.plateaus :], strict=True)
            ]
        )


def _walk_nm2_per_s(experiment: Experiment) -> float:
    return float(experiment.stage.unsubtracted_nm_per_root_s[2] ** 2)


@dataclass(frozen=True, eq=False)
class Heights:
    """Mean heights beside the expected ones.

    Attributes
    ----------
    missed_nm : (plateaus,) recorded less expected, where the bead walks, less how far spectra see
        it gone. whitening : (plateaus, plateaus) triangular, makes these independent pulls.
    ends : per plateau, where a walk has gone by spectra and heights; None where there is none.
    end_pulls, end_sharpness : (plateaus,) what heights have to say of these (`with_heights`).
    """

    missed_nm: FloatArray
    whitening: FloatArray
    ends: list[Walked | None]
    end_pulls: FloatArray
    end_sharpness: FloatArray

    @property
    def pulls(self) -> FloatArray:
        """(plateaus,) missed heights, independent and in standard errors."""
        return self.whitening @ self.missed_nm


def power_about_course(data: PlateauData, expected: Expectation) -> FloatArray:
    """(n_bins, 3, 3) recorded power apart from the expected course of the height."""
    return data.spectrum.power if expected.course is None else _about(data, expected.course)


@functools.lru_cache(maxsize=64)
def _about(data: PlateauData, course: Course) -> FloatArray:
    """Kept, as ln likelihood and its gradient ask for the same."""
    return data.spectrum.power_about(course.transform, 2)


def ends_of(data: PlateauData, expected: Expectation) -> Walked | None:
    """Where a bead that walks has ended; None where it does not."""
    return _ends_of(data, expected) if expected.walked_nm2.any() else None


@functools.lru_cache(maxsize=64)
def _ends_of(data: PlateauData, expected: Expectation) -> Walked:
    """Kept, as spectra and heights ask for the same."""
    inverse, _ = expected.inverse
    return walked(data, inverse, expected.walked_nm2, expected.course_transform)


def random_part(data: PlateauData, expected: Expectation, ends: Walked | None) -> FloatArray:
    """(n_bins, 3, 3) recorded power apart from the course of the height and the line of a walk."""
    power = power_about_course(data, expected)
    if ends is None:
        return power
    return power_without(data, power, ends, expected.course_transform)


def spectral_log_likelihood(data: PlateauData, expected: Expectation) -> float:
    """−Σ n (ln det S + tr S⁻¹P) over bins, about the height's course, and what the ends add of a
    bead that walks.
    """
    inverse, log_determinant = expected.inverse
    trace = np.einsum("fab,fba->f", inverse, power_about_course(data, expected))
    ends = ends_of(data, expected)
    nats = -float(data.spectrum.ordinates @ (log_determinant + trace))
    return nats if ends is None else nats + ends.nats
