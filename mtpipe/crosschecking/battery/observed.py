"""What the battery looks at: a bead's traces, and what the fitted experiment expects of them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.data import PlateauData
from mtpipe.joint_fit.expectation import Expectation


@dataclass(frozen=True, eq=False)
class Observed:
    """One plateau of one bead.

    Attributes
    ----------
    position_nm : (n, 3) on the camera's grid, NaN where lost; drift subtracted.
    reference_nm : (n, 3) reference beads' mean without the drift that was subtracted, or None.
    camera_offset_nm : (n, 3) to be added for the camera's own coordinates.
    data, expected : spectra and mean height, and what they should be.
    frame_s : frame interval.
    ln_force_off : ln of the fitted force over the one that the setup states, or None.
    """

    position_nm: FloatArray
    reference_nm: FloatArray | None
    camera_offset_nm: FloatArray
    data: PlateauData
    expected: Expectation
    frame_s: float
    ln_force_off: float | None = None

    @functools.cached_property
    def bridged_nm(self) -> FloatArray:
        """(3, n) positions about their mean, lost frames bridged by straight lines."""
        return bridged(self.position_nm)

    @functools.cached_property
    def ratio(self) -> FloatArray:
        """(n_bins, 3) power over its expectation, per axis."""
        power = np.diagonal(self.data.spectrum.power, axis1=1, axis2=2)
        return np.asarray(power / np.diagonal(self.expected.power, axis1=1, axis2=2))

    @functools.cached_property
    def level(self) -> FloatArray:
        """(3, n_bins) expected power of each axis, without what prewhitening made of it."""
        spectrum = self.data.spectrum
        return np.array(
            [self.expected.power[:, axis, axis] / spectrum.gain(axis) for axis in range(3)]
        )

    @functools.cached_property
    def whitened(self) -> Whitened:
        """Its single ordinates over their expected size."""
        return whitened(self)

    @property
    def duration_s(self) -> float:
        """Length, lost frames included."""
        return len(self.position_nm) * self.frame_s


@dataclass(frozen=True, eq=False)
class Fixed:
    """What recording and simulations are looked at with alike, from recording and fit.

    Attributes
    ----------
    band_edges_hz : of the bands of power.
    longest_period_nm : (plateaus, 2) up to which periods are looked for, x and y.
    above_hz : (3,) frequencies above which the reference's own motion was not subtracted.
    projection : per plateau and axis, (2, n_bins) what takes a residual P/S − 1 to the changes of
        ln stiffness and ln friction.
    force_weight : (plateaus,) weights of the plateaus in the mean of stated forces.
    """

    band_edges_hz: FloatArray
    longest_period_nm: FloatArray
    above_hz: Sequence[float]
    projection: Sequence[Sequence[FloatArray]]
    force_weight: FloatArray


@dataclass(frozen=True, eq=False)
class Whitened:
    """Single ordinates of a plateau over their expected size: amplitudes of about unit variance.

    `frequency_hz` (n,), `bead` (3, n) and `reference` (3, n) or None, complex.
    """

    frequency_hz: FloatArray
    bead: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
    reference: np.ndarray[tuple[int, ...], np.dtype[np.complex128]] | None


def bridged(series: FloatArray) -> FloatArray:
    """(3, n) of a series (n, 3): without its mean, lost frames bridged by straight lines."""
    filled = np.ascontiguousarray(series.T)
    rows = np.arange(len(series))
    for column in filled:
        lost = np.isnan(column)
        if lost.any():
            known = column[~lost]
            column[lost] = np.interp(rows[lost], rows[~lost], known)
            column -= known.mean()
        else:
            column -= column.mean()
    return np.asarray(filled)


def whitened(seen: Observed) -> Whitened:
    """Single ordinates without 0 and Nyquist, tapered against leakage (Hann)."""
    n = len(seen.position_nm)
    taper, frequency, ln_frequency = _ordinates(n, seen.frame_s)
    scale = np.sqrt(2 * seen.frame_s / n)
    transform = fft.rfft(seen.bridged_nm * taper)[:, 1 : len(frequency) + 1]
    ln_known = np.log(seen.data.spectrum.frequency_hz)
    ln_level = np.array([np.interp(ln_frequency, ln_known, each) for each in np.log(seen.level)])
    reference: np.ndarray[tuple[int, ...], np.dtype[np.complex128]] | None = None
    if seen.reference_nm is not None:
        other = fft.rfft(bridged(seen.reference_nm) * taper)[:, 1 : len(frequency) + 1]
        size = np.sqrt(np.mean(np.abs(other) ** 2, axis=1, keepdims=True))
        reference = np.asarray(other / np.where(size > 0, size, 1.0), dtype=np.complex128)
    return Whitened(frequency, transform * (scale * np.exp(-ln_level / 2)), reference)


@functools.lru_cache(maxsize=64)
def _ordinates(frames: int, frame_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Taper (frames,), frequencies (n,) of the ordinates between 0 and Nyquist, and their ln."""
    taper = np.hanning(frames) * np.sqrt(8 / 3)
    frequency = np.arange(1, (frames - 1) // 2 + 1) / (frames * frame_s)
    return taper, frequency, np.log(frequency)
