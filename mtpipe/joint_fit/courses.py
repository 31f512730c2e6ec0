"""Whether and how the force changes within a plateau, read from the bead's height over time.

A height moves by dL/d ln F per relative change of the force. Its means over windows of time are
compared with a steady force, with a ramp, with settling at several speeds and with a step at
several times; a course is believed where it gains more than such a choice among them costs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import interpolate, optimize

from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import Experiment, ForceCourse
from mtpipe.experiment.readout import force_course
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.expectation import height_nm
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.layers import steady_of
from mtpipe.joint_fit.model import ConfiguredModel

WINDOWS = 48
# Least length of a window, in relaxation times of z: means of windows are then independent.
APART = 4.0
FEWEST_WINDOWS = 8
# Points of a course within a window.
FINE = 8
LARGEST = 0.9
ROUNDING = 1e-9
RAMP = ForceCourse(1.0)
SHAPES = (
    RAMP,
    *(ForceCourse(1.0, "settling", at) for at in (1 / 24, 1 / 12, 1 / 6, 1 / 3)),
    # within every window but the outermost: a step is not found by climbing towards it
    *(ForceCourse(1.0, "step", (k + 0.5) / WINDOWS) for k in range(1, WINDOWS - 1)),
)
# Courses tried for all plateaus together, on a finer grid of times than for one: more data tell the
# time of a common course better.
COMMON = (RAMP, *(ForceCourse(1.0, "settling", at) for at in np.geomspace(0.02, 0.6, 24).tolist()))


@dataclass(frozen=True, eq=False)
class _Heights:
    """Mean heights of a plateau's windows (windows,) nm, their weights, and the chain's height
    against ln of the force over the fitted one.
    """

    means_nm: FloatArray
    weight: FloatArray
    extension: interpolate.CubicSpline

    @property
    def slope_nm(self) -> float:
        """Height per ln of the force."""
        return float(self.extension(0.0, 1))

    def projected(self, shape: ForceCourse) -> tuple[float, float]:
        """Size of a course of this shape by least squares, and its weight."""
        course = self.slope_nm * force_course(shape, len(self.means_nm))
        course = course - np.average(course, weights=self.weight)
        weight = float(np.sum(self.weight * course**2))
        if not weight > ROUNDING * float(self.weight.sum()) * self.slope_nm**2:
            # what is there does not move with this course
            return 0.0, 0.0
        return float(np.sum(self.weight * course * self.means_nm)) / weight, weight


def force_courses(
    fit: ConfiguredFit, positions_nm: Sequence[FloatArray], frame_s: float
) -> tuple[tuple[ForceCourse, ...], ForceCourse]:
    """The force's course in each plateau, and the one that all have in common.

    A change of 0 where none is seen.

    Parameters
    ----------
    fit : whose forces and chain are used. positions_nm : per plateau (n, 3), NaN where lost.
    """
    steady = with_magnets(fit.model.described(fit.theta), courses=())
    heights = [
        _heights(fit.model, steady, i, position[:, 2], frame_s)
        for i, position in enumerate(positions_nm)
    ]
    each = tuple(_course(one, len(heights)) if one else ForceCourse() for one in heights)
    return each, _common([one for one in heights if one])


def _heights(
    model: ConfiguredModel, steady: Experiment, plateau: int, height_nm: FloatArray, frame_s: float
) -> _Heights | None:
    """None where the plateau is too short for its height to be followed."""
    spectrum, force_pN = model.data[plateau].spectrum, steady.rests[plateau].force_pN
    frequency = spectrum.frequency_hz
    level = model.expected(steady, plateau, force_pN).power[:, 2, 2] / spectrum.gain(2)
    relaxation_s = float(level[0]) / (4 * float(np.trapezoid(level, frequency)))
    duration_s = len(height_nm) * frame_s
    windows = int(min(WINDOWS, duration_s / (APART * relaxation_s)))
    if windows < FEWEST_WINDOWS:
        return None
    edges = np.linspace(0, len(height_nm), windows + 1).astype(int)
    pieces = [height_nm[a:b][np.isfinite(height_nm[a:b])] for a, b in itertools.pairwise(edges)]
    count = np.array([len(piece) for piece in pieces])
    means = np.array([piece.mean() if len(piece) else 0.0 for piece in pieces])
    window_s = duration_s / windows
    variance = float(np.interp(1 / (4 * window_s), frequency, level)) / (2 * window_s)
    # frames that are lost make a mean less sure
    return _Heights(means, count / count.max() / variance, _extension(steady, plateau))


def _course(heights: _Heights, plateaus: int) -> ForceCourse:
    # sizes, shapes and plateaus are looked through
    most = 0.5 * math.log(len(heights.means_nm)) + math.log(len(SHAPES)) + math.log(plateaus)
    best = ForceCourse()
    for shape in SHAPES:
        size, weight = heights.projected(shape)
        if 0.5 * size**2 * weight > most:
            size, most = min(max(size, -LARGEST), LARGEST), 0.5 * size**2 * weight
            best = ForceCourse(size, shape.kind, shape.at)
    return _refined(best, heights) if best.relative_change else best


def _common(plateaus: Sequence[_Heights]) -> ForceCourse:
    """The steady change or settling that all plateaus have, as a share of each one's force."""
    windows = sum(len(one.means_nm) for one in plateaus)
    most, best = 0.5 * math.log(max(windows, 1)) + math.log(len(COMMON)), ForceCourse()
    for shape in COMMON if plateaus else []:
        size, weight = np.array([one.projected(shape) for one in plateaus]).T
        if not weight.any():
            continue
        mean, total = float(np.average(size, weights=weight)), float(weight.sum())
        if 0.5 * mean**2 * total > most:
            most = 0.5 * mean**2 * total
            best = ForceCourse(min(max(mean, -LARGEST), LARGEST), shape.kind, shape.at)
    return best


def _extension(steady: Experiment, plateau: int) -> interpolate.CubicSpline:
    """Mean height in nm against ln of the force over the fitted one."""
    tried = np.linspace(-2.5, 1.0, 29)
    forces = (steady.rests[plateau].force_pN * np.exp(tried)).tolist()
    described = steady_of(steady.in_plateau(plateau))
    described.moving.core.know(forces)
    ln_force, extension = [], []
    for value, force in zip(tried.tolist(), forces, strict=True):
        try:
            extension.append(height_nm(described, force))
        except FitError:
            continue
        ln_force.append(value)
    return interpolate.CubicSpline(ln_force, extension)


def _refined(course: ForceCourse, heights: _Heights) -> ForceCourse:
    """Size and time of a course from the heights that the chain has along it."""
    means_nm, weight, extension = heights.means_nm, heights.weight, heights.extension
    windows = len(means_nm)

    def residual(theta: FloatArray) -> FloatArray:
        tried = ForceCourse(float(theta[0]), course.kind, float(theta[1]))
        force = 1 + force_course(tried, FINE * windows)
        low, high = extension.x[[0, -1]]
        along = extension(np.clip(np.log(np.maximum(force, 1e-3)), low, high))
        off = means_nm - along.reshape(windows, FINE).mean(axis=1)
        return np.asarray(np.sqrt(weight) * (off - np.average(off, weights=weight)))

    earliest, latest = {"ramp": (0.0, 1.0), "settling": (0.01, 0.7), "step": (0.01, 0.99)}[
        course.kind
    ]
    start = [course.relative_change, min(max(course.at, earliest), latest)]
    found = optimize.least_squares(
        residual, start, bounds=([-LARGEST, earliest], [LARGEST, latest]), diff_step=[1e-3, 1e-3]
    )
    at = 0.0 if course.kind == "ramp" else float(found.x[1])
    return ForceCourse(float(found.x[0]), course.kind, at)
