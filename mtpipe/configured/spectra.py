"""Spectra of a bead's three axes together: power of each, and what is common to two of them.

Each axis is prewhitened by itself, as in `mtpipe.spectrum`; the phase that this gives an axis is
taken back, so that what is common to two axes keeps its sign. In equilibrium cross-spectra are
real.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from mtpipe.errors import FitError
from mtpipe.physics.camera import FloatArray
from mtpipe.spectrum import LONGEST_SEGMENT, Window, bin_edges, frames_present, window_of


@dataclass(frozen=True, eq=False)
class MatrixSpectrum:
    """Binned periodograms and cross-periodograms of several axes.

    Attributes
    ----------
    frequency_hz : (n_bins,) mean frequency of each bin.
    power : (n_bins, axes, axes) nm²/Hz, real part, one-sided, prewhitened.
    ordinates : (n_bins,) independent ordinates of each bin.
    windows : one per axis, with its prewhitening.
    used : (segments, length) frames that are there with the one before.
    """

    frequency_hz: FloatArray
    power: FloatArray
    ordinates: FloatArray
    windows: tuple[Window, ...]
    used: NDArray[np.bool_]

    def gain(self, axis: int) -> FloatArray:
        """(n_bins,) what prewhitening made of an axis's power."""
        return self.windows[axis].gain(self.frequency_hz)

    def power_of(self, series_nm: FloatArray, axis: int) -> FloatArray:
        """(n_bins,) what a known series, one value a frame from the first, puts into an axis."""
        window = self.windows[axis]
        edges = bin_edges(self.used.shape[1], 1)
        power = np.sum(np.abs(_transform(series_nm, self.used, window.phi)) ** 2, axis=0)
        scale = 2 * window.frame_s / self.used.sum() / np.diff(edges)
        return np.asarray(np.add.reduceat(power[: edges[-1]], edges[:-1]) * scale)


def matrix_periodogram(
    position_nm: FloatArray, frame_s: float, phi: tuple[float, ...]
) -> MatrixSpectrum:
    """Binned periodograms of the frames in which all axes are there.

    Parameters
    ----------
    position_nm : (n, axes) on the camera's grid, NaN where lost.
    phi : prewhitening of each axis.

    Raises
    ------
    FitError : too few frames, or an axis that never moves.
    """
    together = np.asarray(np.isfinite(position_nm).all(axis=1))
    if not np.any(together[1:] & together[:-1]):
        raise FitError("no two successive frames have x, y and z")
    segments = -(-(len(position_nm) - 1) // LONGEST_SEGMENT)
    length = (len(position_nm) - 1) // segments
    # the first frame has no frame before it to be whitened by
    used = together[1:] & together[:-1]
    used = used[: segments * length].reshape(segments, length)
    edges = bin_edges(length, 1)
    windows = tuple(window_of(used, edges, frame_s, p) for p in phi)
    total = np.zeros((len(edges) - 1, len(phi), len(phi)), dtype=complex)
    transforms = []
    for axis, p in enumerate(phi):
        x = np.where(together, position_nm[:, axis], np.nan)
        transform = _transform(x - x[frames_present(x)].mean(), used, p)
        turn = 1 - p * np.exp(-2j * np.pi * np.arange(transform.shape[1]) / length)
        transforms.append(transform * np.conj(turn) / np.abs(turn))
    scale = 2 * frame_s / used.sum() / np.diff(edges)
    for a in range(len(phi)):
        for b in range(a, len(phi)):
            product = np.sum(transforms[a] * np.conj(transforms[b]), axis=0)
            total[:, a, b] = np.add.reduceat(product[: edges[-1]], edges[:-1]) * scale
            total[:, b, a] = np.conj(total[:, a, b])
    return MatrixSpectrum(
        frequency_hz=(edges[:-1] + edges[1:] - 1) / 2 / (length * frame_s),
        power=np.ascontiguousarray(total.real),
        ordinates=windows[0].ordinates,
        windows=windows,
        used=used,
    )


def _transform(x_nm: FloatArray, used: NDArray[np.bool_], phi: float) -> NDArray[np.complex128]:
    """(segments, length//2 + 1) transform of the used frames, prewhitened, less their mean."""
    whitened = (x_nm[1:] - phi * x_nm[:-1])[: used.size].reshape(used.shape)
    rows = np.where(used, whitened, 0.0)
    mean = rows.sum(axis=1, keepdims=True) / np.maximum(used.sum(axis=1, keepdims=True), 1)
    return np.asarray(fft.rfft(np.where(used, rows - mean, 0.0), axis=1))
