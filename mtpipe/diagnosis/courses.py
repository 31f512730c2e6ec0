"""Whether and how the force changes within a plateau, read from the bead's height over time.

A height moves by dL/d ln F per relative change of the force. Its means over windows of time are
compared with a steady force, with a ramp, with settling at several speeds and with a step at
several times; a course is believed where it gains more than such a choice among them costs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from scipy import interpolate, optimize

from mtpipe.configured.fit import ConfiguredFit
from mtpipe.configured.model import ConfiguredModel
from mtpipe.effects.effect import SeenCourse
from mtpipe.errors import FitError
from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import Experiment, ForceCourse
from mtpipe.experiment.readout import force_course
from mtpipe.physics.camera import FloatArray

WINDOWS = 48
# Windows are long enough for their means to be independent: so many relaxation times of z.
APART = 4.0
FEWEST_WINDOWS = 8
# Points of a course within a window.
FINE = 8
LARGEST = 0.9
SHAPES = (
    ForceCourse(1.0),
    *(ForceCourse(1.0, "settling", at) for at in (1 / 24, 1 / 12, 1 / 6, 1 / 3)),
    # within every window but the outermost: a step is not found by climbing towards it
    *(ForceCourse(1.0, "step", (k + 0.5) / WINDOWS) for k in range(1, WINDOWS - 1)),
)


def force_courses(
    fit: ConfiguredFit, positions_nm: Sequence[FloatArray], frame_s: float
) -> tuple[SeenCourse, ...]:
    """The force's course in each plateau, with a change of 0 where none is seen.

    Parameters
    ----------
    fit : whose forces and chain are used. positions_nm : per plateau (n, 3), NaN where lost.
    """
    steady = with_magnets(fit.model.described(fit.theta), courses=())
    return tuple(
        _course(fit.model, steady, i, position[:, 2], frame_s)
        for i, position in enumerate(positions_nm)
    )


def _course(
    model: ConfiguredModel, steady: Experiment, plateau: int, height_nm: FloatArray, frame_s: float
) -> SeenCourse:
    spectrum, force_pN = model.data[plateau].spectrum, steady.rests[plateau].force_pN
    frequency = spectrum.frequency_hz
    level = model.expected(steady, plateau, force_pN).power[:, 2, 2] / spectrum.gain(2)
    relaxation_s = float(level[0]) / (4 * float(np.trapezoid(level, frequency)))
    duration_s = len(height_nm) * frame_s
    windows = int(min(WINDOWS, duration_s / (APART * relaxation_s)))
    if windows < FEWEST_WINDOWS:
        return SeenCourse()
    edges = np.linspace(0, len(height_nm), windows + 1).astype(int)
    pieces = [height_nm[a:b][np.isfinite(height_nm[a:b])] for a, b in itertools.pairwise(edges)]
    count = np.array([len(piece) for piece in pieces])
    means = np.array([piece.mean() if len(piece) else 0.0 for piece in pieces])
    window_s = duration_s / windows
    variance = float(np.interp(1 / (4 * window_s), frequency, level)) / (2 * window_s)
    # frames that are lost make a mean less sure
    weight = count / count.max() / variance
    # sizes, shapes and plateaus are looked through
    penalty = 0.5 * math.log(windows) + math.log(len(SHAPES)) + math.log(len(model.data))
    extension = _extension(model, steady, plateau)
    slope = float(extension(0.0, 1))
    course = _best(means / slope, weight * slope**2, penalty)
    if course.relative_change == 0:
        return SeenCourse()
    return _refined(course, means, weight, extension)


def _extension(model: ConfiguredModel, steady: Experiment, plateau: int) -> interpolate.CubicSpline:
    """Mean height in nm against ln of the force over the fitted one."""
    ln_force, extension = [], []
    for value in np.linspace(-2.5, 1.0, 29).tolist():
        force = steady.rests[plateau].force_pN * math.exp(value)
        try:
            extension.append(model.expected(steady, plateau, force).extension_nm)
        except FitError:
            continue
        ln_force.append(value)
    return interpolate.CubicSpline(ln_force, extension)


def _best(relative: FloatArray, weight: FloatArray, penalty: float) -> ForceCourse:
    """The course that suits relative forces (windows,) of weights (windows,) best."""
    deviation = relative - np.average(relative, weights=weight)
    best, most = ForceCourse(), penalty
    for shape in SHAPES:
        course = force_course(shape, len(relative))
        course = course - np.average(course, weights=weight)
        size = float(np.sum(weight * course * deviation) / np.sum(weight * course**2))
        gain = 0.5 * size**2 * float(np.sum(weight * course**2))
        if gain > most:
            size = min(max(size, -LARGEST), LARGEST)
            best, most = ForceCourse(size, shape.kind, shape.at), gain
    return best


def _refined(
    course: ForceCourse,
    means_nm: FloatArray,
    weight: FloatArray,
    extension: interpolate.CubicSpline,
) -> SeenCourse:
    """Size and time of a course from the heights that the chain has along it."""
    windows = len(means_nm)

    def residual(theta: FloatArray) -> FloatArray:
        tried = ForceCourse(float(theta[0]), course.kind, float(theta[1]))
        force = 1 + force_course(tried, FINE * windows)
        low, high = extension.x[[0, -1]]
        heights = extension(np.clip(np.log(np.maximum(force, 1e-3)), low, high))
        off = means_nm - heights.reshape(windows, FINE).mean(axis=1)
        return np.asarray(np.sqrt(weight) * (off - np.average(off, weights=weight)))

    earliest, latest = {"ramp": (0.0, 1.0), "settling": (0.01, 0.7), "step": (0.01, 0.99)}[
        course.kind
    ]
    start = [course.relative_change, min(max(course.at, earliest), latest)]
    found = optimize.least_squares(
        residual, start, bounds=([-LARGEST, earliest], [LARGEST, latest]), diff_step=[1e-3, 1e-3]
    )
    at = 0.0 if course.kind == "ramp" else float(found.x[1])
    slopes = np.asarray(found.jac)
    stderr = math.sqrt(float(np.linalg.pinv(slopes.T @ slopes)[0, 0]))
    return SeenCourse(ForceCourse(float(found.x[0]), course.kind, at), stderr)
