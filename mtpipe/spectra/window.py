"""What a window of frames sees: its ordinates, its bins and what is expected of them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft, interpolate

from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.spectra.lag_weights import LagWeights
from mtpipe.spectra.recorded_mode import seen_modes_of
from mtpipe.spectra.window_power import expected_powers, log_likelihoods, power_matrices

# Bins grow to this ratio of frequencies: the spectrum of a mode changes by at most 8 % across one.
BIN_GROWTH = 1.04
# τ < D: powers of e^{−D/τ} ≤ 1/e; 36 terms leave 2e-16. τ ≥ D: spline in ln τ.
SHORT_LAGS = 36
LN_TAU_STEP = 0.2
# Covariances transformed at once: of long segments more take too much memory.
AT_A_TIME = 8


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
        one_each = np.asarray(variance, dtype=float)[:, None], np.asarray(tau_s)[:, None]
        return self.expected_of(*one_each, np.zeros(len(tau_s)), exposure_s)

    def expected_of(
        self, variance: FloatArray, tau_s: FloatArray, noise: FloatArray, exposure_s: float
    ) -> FloatArray:
        """Expected power of motions of several modes each, with white tracking noise.

        Parameters
        ----------
        variance, tau_s : (n, modes). noise : (n,) variance in nm².

        Returns
        -------
        (n, n_bins) nm²/Hz, one-sided.
        """
        return expected_powers(variance, tau_s, noise, self.frame_s, exposure_s, *self._compiled)

    def log_likelihood(
        self,
        power: FloatArray,
        ordinates: FloatArray,
        variance: FloatArray,
        tau_s: FloatArray,
        noise: FloatArray,
        exposure_s: float,
    ) -> FloatArray:
        """(n,) ln of a measured power's likelihood (n_bins,) for n motions, up to a constant.

        Parameters
        ----------
        ordinates : (n_bins,) shape of each bin's Gamma law. The others : as of `expected_of`.
        """
        motions = (variance, tau_s, noise, self.frame_s, exposure_s)
        return log_likelihoods(power, ordinates, *motions, *self._compiled)

    @functools.cached_property
    def _compiled(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        return self.white, self.short, self.slow.x, self.slow.c

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
    tau = np.asarray(tau_s, dtype=float)
    longest = np.broadcast_to(np.asarray(longest_s, dtype=float), tau.shape)
    return seen_modes_of(tau, np.ascontiguousarray(longest), camera.frame_s, camera.exposure_s)


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
    """Parts of the values, small enough for the memory with long segments."""
    return np.array_split(values, -(-len(values) // AT_A_TIME))


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


def prewhitened(covariance: FloatArray, phi: float) -> FloatArray:
    """(…, length) covariance of x_t − φ x_(t−1), from that of x (…, length + 1); at lags 0, 1, …"""
    before = np.concatenate([covariance[..., 1:2], covariance[..., :-2]], axis=-1)
    here = (1 + phi**2) * covariance[..., :-1]
    return np.asarray(here - phi * (before + covariance[..., 1:]))
