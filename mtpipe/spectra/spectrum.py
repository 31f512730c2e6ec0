"""Periodograms with gaps, and what a model predicts for exactly those periodograms.

The periodogram of a finite trace with lost frames is not an unbiased estimate of the spectrum: its
expectation is the covariance weighted with how often each lag occurs in the trace (Sykulski et al.
2019, "debiased Whittle"). `Window` computes that expectation exactly for a relaxation mode seen by
a camera, for the frames that are there, averaged over each frequency bin. So neither gaps, nor the
length of the trace, nor the width of a bin, nor the subtracted mean biases a fit.

Power also leaks from strong frequencies to weak ones, through gaps and off the ends of a short
trace, and is then the same few numbers everywhere. The remedy is as old as spectra: prewhitening
(Percival & Walden 1993, section 6.5). The periodogram is that of x_t − φ x_{t−1}, whose spectrum is
nearly flat if φ is the trace's own correlation of successive frames; there is nothing strong to
leak, and ordinates are independent again but for the gaps themselves.

Periodograms are one-sided, per Hz: I_j = (2D/n) |Σ x e^{−iθ_j t}|², n the number of frames present.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.spectra.window import Window, bin_edges, window_of

MINIMUM_FRAMES = 64
# φ below this changes the spectrum by less than a factor of two.
LEAST_PHI = 0.1
PHI_LN_STEP = 0.5
# Largest power over variance × frame of a spectrum that is empty below Nyquist, but for rounding.
LEAST_POWER = 1e-12
# Longer traces are cut into equal segments: their mean periodogram has nearly all the information,
# and neither memory nor time grows faster than the trace.
LONGEST_SEGMENT = 2**16


@dataclass(frozen=True)
class Spectrum:
    """A periodogram averaged in logarithmic bins.

    Attributes
    ----------
    frequency_hz : (n_bins,) mean frequency of each bin.
    power : (n_bins,) nm²/Hz, one-sided, mean of the periodogram's ordinates, prewhitened if φ > 0.
    ordinates : (n_bins,) number of independent ordinates in the mean: the power over its
        expectation follows a Gamma law of this shape.
    share : of the bins' information that is there when they are taken together; below 1 with gaps,
        through which bins are correlated.
    window : predicts the expectation of `power`.
    variance_nm2 : of the frames present, before prewhitening.
    """

    frequency_hz: FloatArray
    power: FloatArray
    ordinates: FloatArray
    share: float
    window: Window
    variance_nm2: float
    frames: int

    @property
    def duration_s(self) -> float:
        """Length of the trace, gaps included."""
        return self.frames * self.window.frame_s

    @property
    def gain(self) -> FloatArray:
        """(n_bins,) what prewhitening made of the power: |1 − φ e^{−iθ}|²."""
        return self.window.gain(self.frequency_hz)


def frames_present(x_nm: FloatArray) -> NDArray[np.bool_]:
    """(n_frames,) which frames are there, of a trace that can be fitted; NaN: lost.

    Raises
    ------
    FitError : fewer than 64 frames are present, or the trace does not move at all.
    """
    present = np.isfinite(x_nm)
    n = int(present.sum())
    if n < MINIMUM_FRAMES:
        raise FitError(
            f"only {n} frames of this trace are there; at least {MINIMUM_FRAMES} are needed"
        )
    if not np.ptp(x_nm[present]) > 0:
        raise FitError("the position never changes in this trace")
    return present


def prewhitening(tau_s: float, frame_s: float) -> float:
    """φ for a trace that relaxes in about τ, rounded so that windows are shared; 0: not worth it.

    Any φ gives an unbiased fit; it only has to make the spectrum about flat.
    """
    phi = math.exp(-frame_s / math.exp(PHI_LN_STEP * round(math.log(tau_s) / PHI_LN_STEP)))
    return phi if phi > LEAST_PHI else 0.0


def periodogram(
    x_nm: FloatArray, frame_s: float, *, lowest_hz: float = 0.0, phi: float = 0.0
) -> Spectrum:
    """Binned periodogram of a trace with gaps.

    Parameters
    ----------
    x_nm : (n_frames,) positions on the camera's grid; NaN where a frame is lost.
    frame_s : frame interval.
    lowest_hz : ordinates below are left out (a high-pass has emptied them).
    phi : x_t − φ x_{t−1} is used instead of x (prewhitening).

    Raises
    ------
    FitError : fewer than 64 frames are present, or the trace does not move at all.
    """
    x = np.asarray(x_nm, dtype=float)
    present = frames_present(x)
    centred = x - x[present].mean()
    variance = float(np.mean(centred[present] ** 2))
    whitened = centred[1:] - phi * centred[:-1] if phi > 0 else centred
    segments = -(-len(whitened) // LONGEST_SEGMENT)
    length = len(whitened) // segments
    pieces = whitened[: segments * length].reshape(segments, length)
    used = np.isfinite(pieces)
    seen = int(used.sum())
    if seen < MINIMUM_FRAMES:
        raise FitError(
            f"only {seen} pairs of successive frames are there; "
            f"at least {MINIMUM_FRAMES} are needed"
        )
    edges = bin_edges(length, max(1, int(np.ceil(lowest_hz * frame_s * length))))
    window = window_of(used, edges, frame_s, phi)
    ordinates = np.zeros(length // 2 + 1)
    for piece, mask in zip(pieces, used, strict=True):
        mean = piece[mask].mean() if mask.any() else 0.0
        ordinates += np.abs(fft.rfft(np.where(mask, piece - mean, 0.0))) ** 2
    ordinates *= 2 * frame_s / seen
    power = np.add.reduceat(ordinates[: edges[-1]], edges[:-1]) / np.diff(edges)
    if not np.max(power) > LEAST_POWER * variance * frame_s:
        raise FitError("the position only flips from each frame to the next and back")
    return Spectrum(
        frequency_hz=(edges[:-1] + edges[1:] - 1) / 2 / (length * frame_s),
        power=power,
        ordinates=window.ordinates,
        share=window.share,
        window=window,
        variance_nm2=variance,
        frames=len(x),
    )
