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

from mtpipe.configured.fit import ConfiguredFit
from mtpipe.experiment.description import ForceCourse
from mtpipe.experiment.readout import force_course
from mtpipe.physics.camera import FloatArray

WINDOWS = 48
# Windows are long enough for their means to be independent: so many relaxation times of z.
APART = 4.0
LARGEST = 0.9
SHAPES = (
    ForceCourse(1.0),
    *(ForceCourse(1.0, "settling", at) for at in (1 / 24, 1 / 12, 1 / 6, 1 / 3)),
    *(ForceCourse(1.0, "step", at) for at in np.linspace(0.05, 0.95, 19).tolist()),
)


def force_courses(
    fit: ConfiguredFit, positions_nm: Sequence[FloatArray], frame_s: float
) -> tuple[ForceCourse, ...]:
    """The force's course in each plateau, with a change of 0 where none is seen.

    Parameters
    ----------
    fit : of the experiment without changes. positions_nm : per plateau (n, 3), NaN where lost.
    """
    return tuple(
        _course(fit, i, position[:, 2], frame_s) for i, position in enumerate(positions_nm)
    )


def _course(fit: ConfiguredFit, plateau: int, height_nm: FloatArray, frame_s: float) -> ForceCourse:
    slopes, spectrum = fit.slopes[plateau], fit.model.data[plateau].spectrum
    per_ln_force_nm = float(slopes.extension_nm[slopes.rows.index(plateau)])
    frequency = spectrum.frequency_hz
    level = fit.expected[plateau].power[:, 2, 2] / spectrum.gain(2)
    relaxation_s = float(level[0]) / (4 * float(np.trapezoid(level, frequency)))
    duration_s = len(height_nm) * frame_s
    windows = int(min(WINDOWS, duration_s / (APART * relaxation_s)))
    if windows < 8:
        return ForceCourse()
    edges = np.linspace(0, len(height_nm), windows + 1).astype(int)
    pieces = [height_nm[a:b][np.isfinite(height_nm[a:b])] for a, b in itertools.pairwise(edges)]
    count = np.array([len(piece) for piece in pieces])
    there = count > 0
    means = np.array([piece.mean() if len(piece) else 0.0 for piece in pieces])
    window_s = duration_s / windows
    variance = float(np.interp(1 / (4 * window_s), frequency, level)) / (2 * window_s)
    # frames that are lost make a mean less sure
    weight = there * count / count.max() / variance
    # sizes, shapes and plateaus are looked through
    penalty = 0.5 * math.log(windows) + math.log(len(SHAPES)) + math.log(len(fit.expected))
    return _best(means / per_ln_force_nm, weight * per_ln_force_nm**2, penalty)


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
