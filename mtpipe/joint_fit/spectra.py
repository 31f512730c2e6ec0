"""Spectra of a bead's three axes together: power of each, and what is common to two of them.

Each axis is prewhitened by itself, as in `spectra.spectrum`; the phase that this gives an axis is
taken back, so that what is common to two axes keeps its sign. In equilibrium cross-spectra are
real. A narrow line may have a bin of its own: in one of a hundred ordinates it would be lost.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.spectra.spectrum import LONGEST_SEGMENT, frames_present
from mtpipe.spectra.window import Window, bin_edges, prewhitened, window_of

Transform = NDArray[np.complex128]
# Ordinates to each side in a line's bin: a wave between two ordinates spreads over these.
LINE_ORDINATES = 2
# Largest prime factor of a number of frames whose Fourier transform is fast.
LARGEST_FACTOR = 100


@dataclass(frozen=True, eq=False)
class MatrixSpectrum:
    """Binned periodograms and cross-periodograms of several axes.

    Attributes
    ----------
    frequency_hz : (n_bins,) mean frequency of each bin.
    power : (n_bins, axes, axes) nm²/Hz, real part, one-sided, prewhitened.
    ordinates : (n_bins,) independent ordinates of each bin.
    edges : (n_bins + 1,) first ordinate of each bin, and one after the last.
    windows : one per axis, with its prewhitening.
    used : (segments, length) frames that are there with the one before.
    transforms : per axis (segments, length//2 + 1), which the powers are of.
    """

    frequency_hz: FloatArray
    power: FloatArray
    ordinates: FloatArray
    edges: NDArray[np.int64]
    windows: tuple[Window, ...]
    used: NDArray[np.bool_]
    transforms: tuple[Transform, ...]

    def gain(self, axis: int) -> FloatArray:
        """(n_bins,) what prewhitening made of an axis's power."""
        return self.windows[axis].gain(self.frequency_hz)

    def transform_of(self, series_nm: FloatArray, axis: int) -> Transform:
        """Transform of a known motion along an axis, one value a frame from the first."""
        return _transforms(series_nm[:, None], self.used, (self.windows[axis].phi,))[0]

    def common_power(self, first: Transform, second: Transform) -> FloatArray:
        """(n_bins,) what two transforms have in common, real part; a transform's own power."""
        return _common_power(first, second, self.edges, self.windows[0].frame_s, self.used)

    def expected_power(self, covariance_nm2: FloatArray) -> FloatArray:
        """(n_bins, axes) that each axis has of a motion with this covariance at lags of 0, 1, 2, …
        frames.

        Parameters
        ----------
        covariance_nm2 : (length + 1,).
        """
        each = np.array([prewhitened(covariance_nm2, window.phi) for window in self.windows])
        per_frame = self.windows[0].lags.expected(each)
        return np.asarray(2 * self.windows[0].frame_s * per_frame.T)

    def per_ordinate(self, weight: FloatArray) -> FloatArray:
        """(length//2 + 1,) by which ordinates of two transforms' product count in the sum over bins
        of weight × what both have in common.

        Parameters
        ----------
        weight : (n_bins,).
        """
        edges, width = self.edges, np.diff(self.edges)
        scale = 2 * self.windows[0].frame_s / self.used.sum()
        each = np.zeros(self.used.shape[1] // 2 + 1)
        each[edges[0] : edges[-1]] = np.repeat(weight * scale / width, width)
        return each

    def power_about(self, motion: Transform, axis: int) -> FloatArray:
        """(n_bins, axes, axes) as `power`, with a known motion along an axis taken off."""
        rest = self.transforms[axis] - motion
        power = self.power.copy()
        for other, transform in enumerate(self.transforms):
            if other != axis:
                power[:, axis, other] = self.common_power(rest, transform)
                power[:, other, axis] = power[:, axis, other]
        power[:, axis, axis] = self.common_power(rest, rest)
        return power


def matrix_periodogram(
    position_nm: FloatArray,
    frame_s: float,
    phi: tuple[float, ...],
    lines_hz: tuple[float, ...] = (),
) -> MatrixSpectrum:
    """Binned periodograms of the frames in which all axes are there, but for the last few where
    their number is not transformed quickly (`quick_length`).

    Parameters
    ----------
    position_nm : (n, axes) on the camera's grid, NaN where lost.
    phi : prewhitening of each axis. lines_hz : frequencies that have bins of their own.

    Raises
    ------
    FitError : too few frames, or an axis that never moves.
    """
    together = np.asarray(np.isfinite(position_nm).all(axis=1))
    if not np.any(together[1:] & together[:-1]):
        raise FitError("no two successive frames have x, y and z")
    segments = -(-(len(position_nm) - 1) // LONGEST_SEGMENT)
    length = quick_length((len(position_nm) - 1) // segments)
    # the first frame has no frame before it to be whitened by
    used = together[1:] & together[:-1]
    used = used[: segments * length].reshape(segments, length)
    edges = edges_about(lines_hz, length, frame_s)
    windows = tuple(window_of(used, edges, frame_s, p) for p in phi)
    total = np.zeros((len(edges) - 1, len(phi), len(phi)))
    x_nm = np.where(together[:, None], position_nm, np.nan)
    means = [x[frames_present(x)].mean() for x in x_nm.T]
    transforms = _transforms(x_nm - means, used, phi)
    for a in range(len(phi)):
        for b in range(a, len(phi)):
            common = _common_power(transforms[a], transforms[b], edges, frame_s, used)
            total[:, a, b] = total[:, b, a] = common
    return MatrixSpectrum(
        frequency_hz=(edges[:-1] + edges[1:] - 1) / 2 / (length * frame_s),
        power=total,
        ordinates=windows[0].ordinates,
        edges=edges,
        windows=windows,
        used=used,
        transforms=transforms,
    )


@functools.lru_cache(maxsize=256)
def quick_length(frames: int) -> int:
    """Largest number up to `frames` whose Fourier transform is fast; at most 1 % fewer.

    A transform of 8191 frames, a prime number, takes several times that of 8190.
    """
    return next(n for n in range(frames, 0, -1) if _largest_factor(n) <= LARGEST_FACTOR)


def _largest_factor(number: int) -> int:
    largest = 1
    for factor in itertools.chain((2,), range(3, math.isqrt(number) + 1, 2)):
        while number % factor == 0:
            number, largest = number // factor, factor
    return max(largest, number)


def edges_about(lines_hz: tuple[float, ...], frames: int, frame_s: float) -> NDArray[np.int64]:
    """The usual bins, but for narrow ones at each line that grow to either side.

    They double in width until they are as wide as the usual ones, so that lines of any width are
    seen.

    Parameters
    ----------
    frames : of a segment.
    """
    edges = usual = bin_edges(frames, 1)
    for line_hz in lines_hz:
        centre = round(line_hz * frames * frame_s)
        here = min(int(np.searchsorted(usual, centre, side="right")), len(usual) - 1)
        width, widest = 2 * LINE_ORDINATES + 1, int(usual[here] - usual[here - 1])
        low, high = centre - LINE_ORDINATES, centre + LINE_ORDINATES + 1
        if widest <= width:
            continue
        around = [low, high]
        while width < widest:
            low, high = low - width, high + width
            around += [low, high]
            width *= 2
        inside = (edges > low) & (edges < high)
        clipped = np.clip(around, edges[0], edges[-1])
        edges = np.unique(np.concatenate([edges[~inside], clipped]))
    return edges


def _common_power(
    first: Transform,
    second: Transform,
    edges: NDArray[np.int64],
    frame_s: float,
    used: NDArray[np.bool_],
) -> FloatArray:
    product = np.sum(first.real * second.real + first.imag * second.imag, axis=0)
    scale = 2 * frame_s / used.sum() / np.diff(edges)
    return np.asarray(np.add.reduceat(product[: edges[-1]], edges[:-1]) * scale)


def _transforms(
    x_nm: FloatArray, used: NDArray[np.bool_], phi: tuple[float, ...]
) -> tuple[Transform, ...]:
    """Transforms of the used frames of each axis, prewhitened, less their mean; the phase of
    prewhitening is taken back.

    Parameters
    ----------
    x_nm : (n, axes). used : (segments, length). phi : per axis.
    """
    x = np.ascontiguousarray(x_nm.T)
    whitened = (x[:, 1:] - np.array(phi)[:, None] * x[:, :-1])[:, : used.size]
    rows = whitened.reshape(len(phi), *used.shape)
    if not used.all():
        rows = np.where(used, rows, 0.0)
    mean = rows.sum(axis=2, keepdims=True) / np.maximum(used.sum(axis=1, keepdims=True), 1)
    each = fft.rfft((rows - mean) * used, axis=2)
    return tuple(one * _turned_back(p, used.shape[1]) for one, p in zip(each, phi, strict=True))


@functools.lru_cache(maxsize=256)
def _turned_back(phi: float, frames: int) -> Transform:
    """(frames//2 + 1,) of size 1, against the phase that prewhitening gives."""
    turn = 1 - phi * np.exp(-2j * np.pi * np.arange(frames // 2 + 1) / frames)
    return np.asarray(np.conj(turn) / np.abs(turn))
