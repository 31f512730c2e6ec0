"""Periodograms with gaps, and what a model predicts for exactly those periodograms.

The periodogram of a finite trace with lost frames is not an unbiased estimate of the spectrum: its
expectation is the covariance weighted with how often each lag occurs in the trace (Sykulski et al.
2019, "debiased Whittle"). `Window` computes that expectation exactly for a relaxation mode seen by
a camera, for the frames that are there, averaged over each frequency bin. So neither gaps, nor the
length of the trace, nor the width of a bin, nor the subtracted mean biases a fit.

Periodograms are one-sided, per Hz: I_j = (2D/n) |Σ x e^{−iθ_j t}|², n the number of frames present.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, interpolate

from mtpipe.errors import FitError
from mtpipe.physics import camera as cam
from mtpipe.physics.camera import Camera, FloatArray

# Bins grow to this ratio of frequencies: the spectrum of a mode changes by at most 8 % across one.
BIN_GROWTH = 1.04
# τ < D: powers of e^{−D/τ} ≤ 1/e; 36 terms leave 2e-16. τ ≥ D: spline in ln τ.
SHORT_LAGS = 36
LN_TAU_STEP = 0.2
MINIMUM_FRAMES = 64


@dataclass(frozen=True)
class Spectrum:
    """A periodogram averaged in logarithmic bins.

    Attributes
    ----------
    frequency_hz : (n_bins,) mean frequency of each bin.
    power : (n_bins,) nm²/Hz, one-sided, mean of the periodogram's ordinates.
    ordinates : (n_bins,) number of independent ordinates in the mean (lost frames taken off): the
        power over its expectation follows a Gamma law of this shape.
    window : predicts the expectation of `power`.
    variance_nm2 : of the frames present.
    """

    frequency_hz: FloatArray
    power: FloatArray
    ordinates: FloatArray
    window: Window
    variance_nm2: float
    frames: int
    lost_frames: int

    @property
    def duration_s(self) -> float:
        """Length of the trace, gaps included."""
        return self.frames * self.window.frame_s


def periodogram(x_nm: FloatArray, frame_s: float, *, lowest_hz: float = 0.0) -> Spectrum:
    """Binned periodogram of a trace with gaps.

    Parameters
    ----------
    x_nm : (n_frames,) positions on the camera's grid; NaN where a frame is lost.
    frame_s : frame interval.
    lowest_hz : ordinates below are left out (a high-pass has emptied them).

    Raises
    ------
    FitError : fewer than 64 frames are present, or the trace does not move at all.
    """
    x = np.asarray(x_nm, dtype=float)
    present = np.isfinite(x)
    n, frames = int(present.sum()), len(x)
    if n < MINIMUM_FRAMES:
        raise FitError(f"only {n} frames of this trace are there; at least 64 are needed")
    centred = np.where(present, x - x[present].mean(), 0.0)
    variance = float(np.sum(centred**2) / n)
    if not variance > 0:
        raise FitError("the position never changes in this trace")
    edges = _bin_edges(frames, max(1, int(np.ceil(lowest_hz * frame_s * frames))))
    window = _window(frames, present.tobytes() if n < frames else None, edges, frame_s)
    ordinates = np.abs(fft.rfft(centred)) ** 2 * (2 * frame_s / n)
    counts = np.diff(edges)
    return Spectrum(
        frequency_hz=(edges[:-1] + edges[1:] - 1) / 2 / (frames * frame_s),
        power=np.add.reduceat(ordinates[: edges[-1]], edges[:-1]) / counts,
        ordinates=counts * (n / frames),
        window=window,
        variance_nm2=variance,
        frames=frames,
        lost_frames=frames - n,
    )


@dataclass(frozen=True, eq=False)
class Window:
    """Expectation of a binned periodogram of the frames that are present.

    Attributes
    ----------
    white : (n_bins,) expectation over 2D for white noise of unit variance.
    short : (SHORT_LAGS, n_bins) the same for unit covariance at lag ±m, m = 1, 2, …
    slow : spline over ln(τ/D) of the logarithm of the same for the covariance e^{−|m|D/τ}.
    """

    frame_s: float
    white: FloatArray
    short: FloatArray
    slow: interpolate.CubicSpline

    def expected(self, variance: FloatArray, tau_s: FloatArray, exposure_s: float) -> FloatArray:
        """Expected power of one mode seen by the camera.

        Parameters
        ----------
        variance : (n,) s² in nm².
        tau_s : (n,) relaxation times.
        exposure_s : exposure W.

        Returns
        -------
        (n, n_bins) nm²/Hz, one-sided.

        Source: PHYSICS section 1, forms A and B with the window's lag weights.
        """
        camera = Camera(self.frame_s, exposure_s)
        tau = np.clip(tau_s, 1e-9 * self.frame_s, self.frame_s * np.exp(self.slow.x[-1]))
        out = np.empty((len(tau), len(self.white)))
        slow = tau >= self.frame_s
        if slow.any():
            alpha = (exposure_s / tau[slow])[:, None]
            kernel = np.exp(self.slow(np.log(tau[slow] / self.frame_s)))
            level = cam.edge_gain(alpha) * kernel - cam.white_deficit(alpha) * self.white
            out[slow] = variance[slow, None] * level
        fast = ~slow
        if fast.any():
            q = np.exp(-self.frame_s / tau[fast])[:, None]
            lags = np.power(q, np.arange(SHORT_LAGS)) @ self.short
            c0 = cam.frame_variance(variance[fast], tau[fast], camera)[:, None]
            c1 = cam.lag_one_covariance(variance[fast], tau[fast], camera)[:, None]
            out[fast] = c0 * self.white + c1 * lags
        return 2 * self.frame_s * out


def _bin_edges(frames: int, first: int) -> NDArray[np.int64]:
    """Ordinates 1 … N/2−1 (0 and Nyquist have another law), in bins of growing width."""
    last = (frames - 1) // 2
    if last - first < 8:
        raise FitError("the trace is too short for the frequencies left to fit")
    edges = [first]
    while edges[-1] <= last:
        edges.append(max(edges[-1] + 1, round(edges[-1] * BIN_GROWTH)))
    edges[-1] = last + 1
    return np.array(edges)


def _window(frames: int, present: bytes | None, edges: NDArray[np.int64], frame_s: float) -> Window:
    return _cached_window(frames, present, tuple(edges.tolist()), frame_s)


@functools.lru_cache(maxsize=64)
def _cached_window(
    frames: int, present: bytes | None, edges: tuple[int, ...], frame_s: float
) -> Window:
    mask = np.ones(frames) if present is None else np.frombuffer(present, dtype=bool).astype(float)
    bins = np.array(edges)
    expectation = _Expectation(mask, bins)
    lags = np.arange(frames)
    white = expectation.of((lags == 0).astype(float))
    short = np.array([expectation.of((lags == m).astype(float)) for m in range(1, SHORT_LAGS + 1)])
    # two knots below τ = D keep the spline's ends away from where it is used
    ln_tau = np.arange(-2 * LN_TAU_STEP, np.log(20.0 * frames) + 2 * LN_TAU_STEP, LN_TAU_STEP)
    slow = np.array([expectation.of(np.exp(-lags * np.exp(-u))) for u in ln_tau])
    return Window(frame_s, white, short, interpolate.CubicSpline(ln_tau, np.log(slow)))


class _Expectation:
    """(1/n) E|Σ_t m_t (x_t − x̄) e^{−iθt}|², binned, for a given covariance of x."""

    def __init__(self, mask: FloatArray, edges: NDArray[np.int64]) -> None:
        self.mask, self.edges = mask, edges
        self.frames, self.n = len(mask), float(mask.sum())
        self.gapless = self.n == self.frames
        self.length = fft.next_fast_len(2 * self.frames)
        self.padded = fft.rfft(mask, self.length)
        self.mask_dft = fft.rfft(mask)
        pairs = fft.irfft(np.abs(self.padded) ** 2, self.length)[: self.frames]
        self.weights = np.maximum(pairs, 0.0) / self.n

    def of(self, covariance: FloatArray) -> FloatArray:
        weighted = covariance * self.weights
        # at the Fourier frequencies lag m − N is the same phase as lag m
        folded = weighted.copy()
        folded[1:] += weighted[:0:-1]
        power = fft.rfft(folded).real
        if not self.gapless:
            power = power + self._mean_subtraction(covariance)
        binned = np.add.reduceat(power[: self.edges[-1]], self.edges[:-1]) / np.diff(self.edges)
        return np.asarray(binned)

    def _mean_subtraction(self, covariance: FloatArray) -> FloatArray:
        """The change that subtracting the mean of the frames present makes (none without gaps)."""
        symmetric = np.zeros(self.length)
        symmetric[: self.frames] = covariance
        symmetric[-self.frames + 1 :] += covariance[:0:-1]
        smooth = fft.irfft(fft.rfft(symmetric).real * self.padded, self.length)[: self.frames]
        smooth *= self.mask
        with_mean = fft.rfft(smooth) / self.n
        mean_variance = smooth.sum() / self.n**2
        cross = -2 * np.real(with_mean * np.conj(self.mask_dft))
        return np.asarray((cross + mean_variance * np.abs(self.mask_dft) ** 2) / self.n)
