"""How expected spectra and heights change with the parameters of a configured experiment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.data import PlateauData
from mtpipe.joint_fit.expectation import (
    DIFFERENCE,
    Expectation,
    answered,
    know_states,
    larger_pN,
)
from mtpipe.joint_fit.height_course import CourseSlopes
from mtpipe.joint_fit.model import ConfiguredModel
from mtpipe.joint_fit.random_walk import Walked, line_of, walked
from mtpipe.joint_fit.spectra import Transform


@dataclass(frozen=True, eq=False)
class Slopes:
    """How one plateau's expectation follows θ.

    Attributes
    ----------
    rows : (k,) which coordinates move it. power : (k, n_bins, 3, 3) of what is left to chance and
        extension_nm : (k,) per unit of each.
    inverse : (n_bins, 3, 3) inverse of that power. whitened : inverse · power slopes.
    walked : (k, 3) of the variance of where a walk ends.
    course : of the height's course; None where there is none.
    """

    rows: list[int]
    power: FloatArray
    extension_nm: FloatArray
    inverse: FloatArray
    whitened: FloatArray
    walked: FloatArray
    course: CourseSlopes | None = None


def slopes(model: ConfiguredModel, theta: FloatArray, expected: list[Expectation]) -> list[Slopes]:
    """Derivatives of all plateaus' expectations at θ, by one-sided differences.

    Raises
    ------
    FitError : a step to either side leaves the bead on the surface.
    """
    n, plateaus = len(theta), model.plateaus
    experiment = model.described(theta)
    shifted = model.beside(theta)
    forces = [rest.force_pN for rest in experiment.rests]
    for _, other in shifted:
        know_states(model.data, other, [[force] for force in forces])
    asked = [model.asked_in_each(experiment, [larger_pN(force) for force in forces])]
    asked += [model.asked_in_each(other, forces) for _, other in shifted]
    # what is asked of one plateau together
    answers = iter(model.expectations([one for each in zip(*asked, strict=True) for one in each]))
    found = []
    for i, here in enumerate(expected):
        others = [(DIFFERENCE, answered(next(answers)))]
        for k, (step, _) in enumerate(shifted):
            there = next(answers)
            if isinstance(there, FitError):
                # a step that way leaves the bead on the surface
                back = theta.copy()
                back[plateaus + k] -= step
                step, there = -step, model.expected(model.described(back), i, forces[i])
            others.append((step, there))
        inverse, _ = here.inverse
        step_of = np.array([step for step, _ in others])
        power = np.array([other.random_power for _, other in others]) - here.random_power
        power /= step_of[:, None, None, None]
        height = (np.array([o.extension_nm for _, o in others]) - here.extension_nm) / step_of
        whitened = np.asarray(inverse @ power)
        ends = (np.array([o.walked_nm2 for _, o in others]) - here.walked_nm2) / step_of[:, None]
        course = _course_slopes(here, others)
        rows = [i, *range(plateaus, n)]
        found.append(Slopes(rows, power, height, inverse, whitened, ends, course))
    return found


def _course_slopes(
    here: Expectation, others: Sequence[tuple[float, Expectation]]
) -> CourseSlopes | None:
    known = next((one.course for _, one in others if one.course is not None), here.course)
    if known is None:
        return None
    steady = np.zeros_like(known.weights)
    at = steady if here.course is None else here.course.weights
    weights = [
        ((steady if other.course is None else other.course.weights) - at) / step
        for step, other in others
    ]
    return CourseSlopes(known.shape, np.array(weights))


def ends_with_slopes(data: PlateauData, here: Expectation, slope: Slopes) -> Walked:
    """How far the bead has walked off at a plateau's end, with the slopes of its spectra."""
    return walked(data, slope.inverse, here.walked_nm2, here.course_transform)


def left_of_z(
    data: PlateauData, here: Expectation, slope: Slopes, ends: Walked | None
) -> Transform:
    """Slope of ln likelihood by the course of z at each ordinate: what is left of z beside that
    course and a walk's line, given x and y, weighted.
    """
    spectrum = data.spectrum
    rest = list(spectrum.transforms)
    if here.course is not None:
        rest[2] = rest[2] - here.course.transform
    if ends is not None:
        lines = line_of(data).transforms
        rest = [one - end * line for one, end, line in zip(rest, ends.mean_nm, lines, strict=True)]
    weights = 2 * spectrum.ordinates[:, None] * slope.inverse[:, 2]
    each = [spectrum.per_ordinate(w) * one for w, one in zip(weights.T, rest, strict=True)]
    return each[0] + each[1] + each[2]


def height_slopes(derivatives: Sequence[Slopes], coordinates: int) -> FloatArray:
    """(plateaus, coordinates) how mean heights follow θ."""
    found = np.zeros((len(derivatives), coordinates))
    for row, slope in zip(found, derivatives, strict=True):
        row[slope.rows] = slope.extension_nm
    return found


def walk_slopes(model: ConfiguredModel, theta: FloatArray) -> FloatArray:
    """(coordinates,) how the square of the random walk of z follows θ."""
    found = np.zeros(len(theta))
    here = model.walk_nm2_per_s(theta)
    for k in model.walking:
        step, moved = model.parameters[k - model.plateaus].step_from(theta[k]), theta.copy()
        moved[k] += step
        found[k] = (model.walk_nm2_per_s(moved) - here) / step
    return found
