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

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft, interpolate

from mtpipe.ground.errors import FitError
from mtpipe.physics import camera as cam
from mtpipe.physics.camera import Camera, FloatArray
from mtpipe.spectra.window_power import power_matrices, powers_of_modes

# Bins grow to this ratio of frequencies: the spectrum of a mode changes by at most 8 % across one.
BIN_GROWTH = 1.04
# τ < D: powers of e^{−D/τ} ≤ 1/e; 36 terms leave 2e-16. τ ≥ D: spline in ln τ.
SHORT_LAGS = 36
LN_TAU_STEP = 0.2
# So many covariances are transformed at once.
AT_A_TIME = 8
# Modes that relax within a smaller share of a frame are as white as this one.
SHORTEST = 1e-9
MINIMUM_FRAMES = 64
# φ below this changes the spectrum by less than a factor of two.
LEAST_PHI = 0.1
PHI_LN_STEP = 0.5
# A trace whose spectrum is empty below Nyquist, but for rounding.
LEAST_POWER = 1e-12
# Longer traces are cut into equal segments: their mean periodogram has nearly all the information,
# and neither memory nor time grows faster than the trace.
LONGEST_SEGMENT = 2**16
MEAN_MATTERS_BELOW = 0.95


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


@dataclass(frozen=True, eq=False)
class Window:
    """Expectation of a binned periodogram of the frames that are present.

    Attributes
    ----------
    white : (n_bins,) expectation over 2D for white noise of unit variance.
    short : (SHORT_LAGS, n_bins) the same for unit covariance at lag ±m, m = 1, 2, …
    slow : spline over ln(τ/D) of the logarithm of the same for the covariance e^{−|m|D/τ}.
    ordinates, share : as of `Spectrum`.
    phi : of the prewhitening. lags : for any other covariance.
    """

    frame_s: float
    phi: float
    ordinates: FloatArray
    share: float
    white: FloatArray
    short: FloatArray
    slow: interpolate.CubicSpline
    lags: LagWeights

    def gain(self, frequency_hz: FloatArray) -> FloatArray:
        """What prewhitening made of the power at a frequency: |1 − φ e^{−iθ}|²."""
        half = np.pi * frequency_hz * self.frame_s
        return np.asarray((1 - self.phi) ** 2 + 4 * self.phi * np.sin(half) ** 2)

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
        modes = seen_modes(tau_s, self.longest_s, Camera(self.frame_s, exposure_s))
        of_window = (self.white, self.short, self.slow.x, self.slow.c)
        unit = powers_of_modes(*modes, *of_window)
        return np.asarray((2 * self.frame_s * np.asarray(variance))[:, None] * unit)

    @functools.cached_property
    def longest_s(self) -> float:
        """Relaxation time beyond which a mode is no more than a trend of the trace."""
        return float(self.frame_s * np.exp(self.slow.x[-1]))


def seen_modes(
    tau_s: FloatArray, longest_s: FloatArray | float, camera: Camera
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Relaxation times over D, white and correlated part (`camera.recorded_parts`) of modes.

    (n,) of each. Of what is slower than a segment only the variance over τ is seen.

    Parameters
    ----------
    tau_s : (n,). longest_s : (n,) or one for all, of the windows they are seen through.
    """
    tau = np.clip(tau_s, SHORTEST * camera.frame_s, longest_s)
    seen = np.minimum(longest_s / np.asarray(tau_s), 1.0)
    white, correlated = cam.recorded_parts(tau, camera)
    return tau / camera.frame_s, seen * white, seen * correlated


def expected_matrices(
    windows: Sequence[Window],
    modes: tuple[FloatArray, FloatArray, FloatArray],
    covariance: FloatArray,
    first: NDArray[np.int64],
) -> FloatArray:
    """Expected power matrices of motions that have some modes each, which move several axes.

    What two axes have in common is of the geometric mean of their windows.

    Parameters
    ----------
    windows : one per axis, of the same frames. modes : of all motions (`seen_modes`).
    covariance : (n, axes, axes) in nm². first : (motions + 1,) first mode of each motion, and one
        after the last.

    Returns
    -------
    (motions, n_bins, axes, axes) nm²/Hz, one-sided.
    """
    power = power_matrices(
        first,
        *modes,
        covariance,
        tuple(window.white for window in windows),
        tuple(window.short for window in windows),
        tuple(window.slow.x for window in windows),
        tuple(window.slow.c for window in windows),
    )
    return np.multiply(power, 2 * windows[0].frame_s, out=power)


@functools.lru_cache(maxsize=256)
def bin_edges(frames: int, first: int) -> NDArray[np.int64]:
    """Ordinates 1 … N/2−1 (0 and Nyquist have another law), in bins of growing width."""
    last = (frames - 1) // 2
    if last - first < 8:
        raise FitError("the trace is too short for the frequencies left to fit")
    edges = [first]
    while edges[-1] <= last:
        edges.append(max(edges[-1] + 1, round(edges[-1] * BIN_GROWTH)))
    edges[-1] = last + 1
    found = np.array(edges)
    found.flags.writeable = False
    return found


def window_of(
    used: NDArray[np.bool_], edges: NDArray[np.int64], frame_s: float, phi: float
) -> Window:
    """Expectations for segments (segments, length) of which the `used` frames are there."""
    key = None if used.all() else used.tobytes()
    return _window(*used.shape, key, tuple(edges.tolist()), frame_s, phi)


@functools.lru_cache(maxsize=64)
def _window(
    segments: int,
    length: int,
    present: bytes | None,
    edges: tuple[int, ...],
    frame_s: float,
    phi: float,
) -> Window:
    lags, ordinates, share = _of_frames(segments, length, present, edges)
    # one lag more than there is: prewhitening looks one ahead
    lag = np.arange(length + 1)
    # two knots below τ = D keep the spline's ends away from where it is used
    ln_tau = np.arange(-2 * LN_TAU_STEP, np.log(20.0 * length) + 2 * LN_TAU_STEP, LN_TAU_STEP)
    white, *short = (
        one
        for some in _few_at_a_time(np.arange(SHORT_LAGS + 1.0))
        for one in lags.expected(prewhitened((lag == some[:, None]).astype(float), phi))
    )
    slow = [
        one
        for some in _few_at_a_time(ln_tau)
        for one in lags.expected(prewhitened(np.exp(-lag * np.exp(-some)[:, None]), phi))
    ]
    return Window(
        frame_s=frame_s,
        phi=phi,
        ordinates=ordinates,
        share=share,
        white=white,
        short=np.array(short),
        slow=interpolate.CubicSpline(ln_tau, np.log(slow)),
        lags=lags,
    )


@functools.lru_cache(maxsize=32)
def _of_frames(
    segments: int, length: int, present: bytes | None, edges: tuple[int, ...]
) -> tuple[LagWeights, FloatArray, float]:
    """What windows of the same frames have in common: lag weights, and `_independent_ordinates`."""
    masks = (
        np.ones((segments, length), dtype=bool)
        if present is None
        else np.frombuffer(present, dtype=bool).reshape(segments, length)
    )
    return LagWeights(masks, np.array(edges)), *_independent_ordinates(masks, np.array(edges))


def _few_at_a_time(values: FloatArray) -> list[FloatArray]:
    """Of long segments more take too much memory."""
    return np.array_split(values, -(-len(values) // AT_A_TIME))


def prewhitened(covariance: FloatArray, phi: float) -> FloatArray:
    """(…, length) covariance of x_t − φ x_(t−1), from that of x (…, length + 1); at lags 0, 1, …"""
    before = np.concatenate([covariance[..., 1:2], covariance[..., :-2]], axis=-1)
    here = (1 + phi**2) * covariance[..., :-1]
    return np.asarray(here - phi * (before + covariance[..., 1:]))


def _independent_ordinates(
    masks: NDArray[np.bool_], edges: NDArray[np.int64]
) -> tuple[FloatArray, float]:
    """How many independent ordinates each bin has, and the share left in all of them together.

    For a flat spectrum the ordinates j and k of one segment with n frames present have the
    correlation |M̂_{j−k}|²/n², M̂ the transform of the mask; without gaps there is none.
    """
    counts = np.diff(edges).astype(float)
    if masks.all():
        return counts * len(masks), 1.0
    total = float(masks.sum())
    covariance = np.zeros((len(counts), len(counts)))
    for mask in masks:
        line = np.abs(fft.fft(mask.astype(float))) ** 2 / total**2
        # Σ_{a≤j<b, c≤k<d} line_{|j−k|} from the second sum of the line
        half = line[: edges[-1] + 1]
        symmetric = np.concatenate([half[:0:-1], half])
        second = np.cumsum(np.cumsum(symmetric))
        origin = len(half) - 1

        def area(shift: NDArray[np.int64], second: FloatArray = second, o: int = origin) -> Any:
            return second[np.clip(shift + o - 1, 0, len(second) - 1)]

        low, high = edges[:-1], edges[1:]
        covariance += (
            area(high[:, None] - low[None, :])
            - area(low[:, None] - low[None, :])
            - area(high[:, None] - high[None, :])
            + area(low[:, None] - high[None, :])
        )
    ordinates = counts**2 / np.diag(covariance)
    together = counts.sum() ** 2 / covariance.sum()
    return ordinates, float(min(together / ordinates.sum(), 1.0))


class LagWeights:
    """(1/n) Σ_segments E|Σ_t m_t (x_t − x̄) e^{−iθt}|², binned, for given covariances of x, which is
    prewhitened already.
    """

    def __init__(self, masks: NDArray[np.bool_], edges: NDArray[np.int64]) -> None:
        self.edges, self.length, self.n = edges, masks.shape[1], float(masks.sum())
        self.padding = fft.next_fast_len(2 * self.length)
        pairs = np.zeros(self.padding // 2 + 1)
        for mask in masks:
            pairs += np.abs(fft.rfft(mask.astype(float), self.padding)) ** 2
        weights = fft.irfft(pairs, self.padding)[: self.length] / self.n
        self.weights = np.maximum(weights, 0.0)
        # with several segments relaxation is short against each, and what subtracting a segment's
        # mean over its gaps changes is far below the statistical error, as it is for few gaps
        mean_matters = len(masks) == 1 and self.n < MEAN_MATTERS_BELOW * self.length
        self.gaps = masks[0].astype(float) if mean_matters else None

    def expected(self, covariance: FloatArray) -> FloatArray:
        """(k, n_bins) for covariances (k, length) at lags 0 … length − 1."""
        weighted = covariance * self.weights
        # at the Fourier frequencies lag m − N is the same phase as lag m
        folded = weighted.copy()
        folded[:, 1:] += weighted[:, :0:-1]
        power = fft.rfft(folded).real
        if self.gaps is not None:
            power = power + self._mean_subtraction(covariance, self.gaps)
        inside, first = power[:, : self.edges[-1]], self.edges[:-1]
        return np.asarray(np.add.reduceat(inside, first, axis=1) / np.diff(self.edges))

    def _mean_subtraction(self, covariance: FloatArray, mask: FloatArray) -> FloatArray:
        """The change that subtracting the mean of the frames present makes (none without gaps)."""
        of_mask, padded = fft.rfft(mask), fft.rfft(mask, self.padding)
        symmetric = np.zeros((len(covariance), self.padding))
        symmetric[:, : self.length] = covariance
        symmetric[:, -self.length + 1 :] += covariance[:, :0:-1]
        spectrum = fft.rfft(symmetric).real * padded
        smooth = mask * fft.irfft(spectrum, self.padding)[:, : self.length]
        cross = -2 * np.real(fft.rfft(smooth) / self.n * np.conj(of_mask))
        variance = smooth.sum(axis=1, keepdims=True) / self.n**2
        return np.asarray((cross + variance * np.abs(of_mask) ** 2) / self.n)
