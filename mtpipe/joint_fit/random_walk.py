"""How far a bead has walked off in the end of a plateau, and what spectra are apart from that.

A random walk is a bridge, which ends where it began, and a straight line to where it ends. Both
are independent, and so are the bridge's ordinates (Watson 1961, Biometrika 48:109); the line is in
all of them at once. Power matrices S are expected of all but the line; its three unknown ends X,
Gaussian with variances σ², are integrated out, which leaves Gaussian ends with a mean and a
covariance.
"""

from __future__ import annotations

import functools
from collections.abc import Hashable
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.batch_cache import BatchCache
from mtpipe.joint_fit.data import PlateauData
from mtpipe.joint_fit.spectra import Transform


@dataclass(frozen=True, eq=False)
class Line:
    """A straight line from 0 to 1 nm through a plateau, along each axis.

    Attributes
    ----------
    transforms : per axis, as of the recorded ones. power : (n_bins, 3, 3) of two lines in common.
    """

    transforms: tuple[Transform, ...]
    power: FloatArray


# Cache of lines: data of the same frames, as those of simulations, share one.
_LINES: BatchCache[tuple[Hashable, ...], Line] = BatchCache(64)


def sees_walks(data: PlateauData) -> bool:
    """Whether lines are told apart: of longer recordings spectra are means of several, whose lines
    are not one.
    """
    return len(data.spectrum.used) == 1


def line_of(data: PlateauData) -> Line:
    """The line of a plateau."""
    spectrum = data.spectrum
    frames = round(data.duration_s / spectrum.windows[0].frame_s)
    key = (*spectrum.windows, frames)
    line = _LINES.get(key)
    if line is None:
        rising = np.arange(frames) / frames
        transforms = tuple(spectrum.transform_of(rising, axis) for axis in range(3))
        line = Line(transforms, _in_common(data, transforms, transforms))
        _LINES.put(key, line)
    return line


@functools.lru_cache(maxsize=64)
def _with_data(data: PlateauData) -> FloatArray:
    """(n_bins, 3, 3) of the line of each axis and each recorded axis in common."""
    return _in_common(data, line_of(data).transforms, data.spectrum.transforms)


def _in_common(
    data: PlateauData, first: tuple[Transform, ...], second: tuple[Transform, ...]
) -> FloatArray:
    rows = [[data.spectrum.common_power(a, b) for b in second] for a in first]
    return np.moveaxis(np.array(rows), -1, 0)


@dataclass(frozen=True, eq=False)
class Walked:
    """Posterior of where the walk ended in a plateau, given its spectra.

    Attributes
    ----------
    mean_nm : (3,). covariance_nm2 : (3, 3).
    nats : of ln likelihood, over that with no line.
    pull : (3,) the mean over σ². seen : (3, 3) what the covariance has lost of σ², over σ⁴.
    left : (3, 3) the covariance over σ² of the first axis.
    """

    mean_nm: FloatArray
    covariance_nm2: FloatArray
    nats: float
    pull: FloatArray
    seen: FloatArray
    left: FloatArray

    def with_heights(self, pull: float, sharpness: float, variance_nm2: FloatArray) -> Walked:
        """The same given the mean heights too, which constrain the end in z.

        Parameters
        ----------
        pull, sharpness : slope and curvature of their ln likelihood where the end is expected by
            spectra alone, all that is not known of other ends included. variance_nm2 : (3,) σ².
        """
        left = self.left[:, 2]
        lost = sharpness * np.outer(left, left)
        both = self.pull + left * pull
        covariance = self.covariance_nm2 - lost * np.outer(variance_nm2, variance_nm2)
        return replace(
            self,
            mean_nm=variance_nm2 * both,
            covariance_nm2=covariance,
            pull=both,
            seen=self.seen + lost,
        )


def walked(
    data: PlateauData, inverse: FloatArray, variance_nm2: FloatArray, course: Transform | None
) -> Walked:
    """The ends of a plateau.

    Parameters
    ----------
    inverse : (n_bins, 3, 3) of the power matrices apart from the line. variance_nm2 : (3,) σ².
    course : what is known to be in z.
    """
    line = line_of(data)
    weighted = data.spectrum.ordinates[:, None, None] * inverse
    sharpness = np.einsum("fab,fab->ab", weighted, line.power)
    towards = np.einsum("fab,fab->a", weighted, _about(data, course))
    grown = np.eye(3) + 2 * sharpness * variance_nm2
    left = np.linalg.inv(grown)
    pull = 2 * left @ towards
    mean = variance_nm2 * pull
    nats = float(towards @ mean) - 0.5 * float(np.linalg.slogdet(grown)[1])
    return Walked(mean, variance_nm2[:, None] * left, nats, pull, 2 * left @ sharpness, left)


def _about(data: PlateauData, course: Transform | None) -> FloatArray:
    """(n_bins, 3, 3) of each line and each recorded axis, z about its course."""
    if course is None:
        return _with_data(data)
    found = _with_data(data).copy()
    rest = data.spectrum.transforms[2] - course
    for axis, transform in enumerate(line_of(data).transforms):
        found[:, axis, 2] = data.spectrum.common_power(transform, rest)
    return found


def power_without(
    data: PlateauData, power: FloatArray, ends: Walked, course: Transform | None
) -> FloatArray:
    """(n_bins, 3, 3) recorded power apart from the line, as expected over its ends.

    Parameters
    ----------
    power : recorded, about the course. course : that was taken off.
    """
    line = line_of(data)
    crossed = ends.mean_nm[:, None] * _about(data, course)
    square = np.outer(ends.mean_nm, ends.mean_nm) + ends.covariance_nm2
    return np.asarray(power - crossed - np.swapaxes(crossed, 1, 2) + square * line.power)
