"""The height's course through a plateau during which the force changes.

The force follows a known shape; how much it changes by is fitted. Height is nearly linear in ln of
the force, so it is computed at a few forces and interpolated by a polynomial of ln force. That is
nearly a polynomial of the shape: transforms of the shape's Chebyshev polynomials, computed once,
serve changes of any size and any bead.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev

from mtpipe.experiment.description import ForceCourse
from mtpipe.experiment.readout import COURSE_POINTS, force_course, height_weights
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.data import PlateauData
from mtpipe.joint_fit.spectra import MatrixSpectrum, Transform

# If the force changes by less than 10 % in a plateau, heights are computed at 3 forces only and
# spectra at the mean force alone.
FEWER_POINTS, SMALL_CHANGE = 3, 0.1
# Degree of the polynomials in the height: for a change by half of the force good to 1e-6.
DEGREE = 12
# Chebyshev nodes, and the matrix from values there to a polynomial's coefficients.
_PLACES = chebyshev.chebpts1(DEGREE + 1)
_COEFFICIENTS = np.linalg.inv(chebyshev.chebvander(_PLACES, DEGREE)).T


@dataclass(frozen=True, eq=False)
class Shape:
    """Shape of a force's course through a plateau.

    Attributes
    ----------
    spectrum : of the plateau; which frames there are.
    low, high : least and largest of the shape, per relative change of the force.
    transforms : (DEGREE + 1, segments, length//2 + 1) of its Chebyshev polynomials, as of the
        recorded z. means : (DEGREE + 1,) of these.
    share : (COURSE_POINTS,) of the time that counts for places evenly apart from low to high,
        linear between them.
    """

    spectrum: MatrixSpectrum
    low: float
    high: float
    transforms: Transform
    means: FloatArray
    share: FloatArray

    @property
    def _rows(self) -> FloatArray:
        """(DEGREE + 1, numbers) transforms, real and imaginary parts as numbers of their own."""
        return self.transforms.view(np.float64).reshape(len(self.transforms), -1)

    def transform(self, weights: FloatArray) -> Transform:
        """Transform of a sum of the polynomials with these weights (DEGREE + 1,)."""
        return (weights @ self._rows).view(np.complex128).reshape(self.transforms.shape[1:])

    def in_common(self, other: Transform) -> FloatArray:
        """(DEGREE + 1,) sum over ordinates of what each polynomial has in common with another
        motion, real part.
        """
        return np.asarray(self._rows @ np.ascontiguousarray(other).view(np.float64).ravel())

    def in_common_with_itself(self, weight: FloatArray) -> FloatArray:
        """(DEGREE + 1, DEGREE + 1) the same of each two, the ordinates weighted.

        Parameters
        ----------
        weight : (length//2 + 1,).
        """
        weighted = (self.transforms * weight).view(np.float64).reshape(len(self.transforms), -1)
        return np.asarray(weighted @ self._rows.T)


@dataclass(frozen=True, eq=False)
class Course:
    """The height of a plateau during which the force changes.

    Attributes
    ----------
    shape : of the force's course. weights : (DEGREE + 1,) of its polynomials, in nm.
    """

    shape: Shape
    weights: FloatArray

    @functools.cached_property
    def transform(self) -> Transform:
        """As of the recorded z."""
        return self.shape.transform(self.weights)

    @property
    def mean_nm(self) -> float:
        """Over the plateau."""
        return float(self.shape.means @ self.weights)

    @functools.cached_property
    def power(self) -> FloatArray:
        """(n_bins,) that z has of it."""
        return self.shape.spectrum.common_power(self.transform, self.transform)


@dataclass(frozen=True, eq=False)
class CourseSlopes:
    """How a height's course follows some coordinates.

    Attributes
    ----------
    shape : of the force's course. weights : (k, DEGREE + 1) of its polynomials, in nm per unit of
        each coordinate.
    """

    shape: Shape
    weights: FloatArray

    def moved(self, course: Course, change: FloatArray) -> Course:
        """A course where the coordinates are changed by (k,)."""
        return Course(course.shape, course.weights + change @ self.weights)

    def in_common(self, other: Transform) -> FloatArray:
        """(k,) sums over ordinates of what each slope has in common with another motion."""
        return np.asarray(self.weights @ self.shape.in_common(other))

    def in_common_with_itself(self, weight: FloatArray) -> FloatArray:
        """(k, k) the same of each two slopes, the ordinates weighted (length//2 + 1,)."""
        return np.asarray(self.weights @ self.shape.in_common_with_itself(weight) @ self.weights.T)


@dataclass(frozen=True, eq=False)
class Played:
    """A force's course through a plateau, whatever the bead.

    Attributes
    ----------
    nodes : force over its mean, less 1, at which heights are asked for, from the least.
    weights : (nodes, DEGREE + 1) of the shape's polynomials per nm of height at each.
    standing, share : force over its mean, less 1, that stands for spectra, and for how much of the
        time.
    """

    shape: Shape
    nodes: tuple[float, ...]
    weights: FloatArray
    standing: FloatArray
    share: FloatArray

    def course(self, heights_nm: FloatArray) -> Course:
        """Course of the height, from the heights (nodes,) at the nodes."""
        return Course(self.shape, heights_nm @ self.weights)


@functools.lru_cache(maxsize=64)
def played(data: PlateauData, course: ForceCourse, frame_s: float) -> Played:
    """A course whose force changes."""
    shape = _shape(data, replace(course, relative_change=1.0), frame_s)
    low, high = sorted((course.relative_change * shape.low, course.relative_change * shape.high))
    nodes = np.linspace(low, high, FEWER_POINTS if high - low < SMALL_CHANGE else COURSE_POINTS)
    along = shape.low + (_PLACES + 1) / 2 * (shape.high - shape.low)
    relative = course.relative_change * along
    weights = height_weights(nodes, relative) @ _COEFFICIENTS
    if len(nodes) == FEWER_POINTS:
        standing, share = np.zeros(1), np.ones(1)
    else:
        share = shape.share if course.relative_change > 0 else shape.share[::-1]
        counts = share > 1e-3
        standing, share = nodes[counts], share[counts] / share[counts].sum()
    return Played(shape, tuple(nodes.tolist()), weights, standing, share)


@functools.lru_cache(maxsize=64)
def _shape(data: PlateauData, whole: ForceCourse, frame_s: float) -> Shape:
    """Shape of a course of relative change 1."""
    along = force_course(whole, round(data.duration_s / frame_s))
    low, high = float(along.min()), float(along.max())
    place = 2 * (along - low) / (high - low) - 1
    polynomials = chebyshev.chebvander(place, DEGREE).T
    transforms = np.array([data.spectrum.transform_of(one, 2) for one in polynomials])
    points = np.linspace(-1, 1, COURSE_POINTS)
    share = np.array([np.interp(place, points, row).mean() for row in np.eye(COURSE_POINTS)])
    return Shape(data.spectrum, low, high, transforms, polynomials.mean(axis=1), share)
