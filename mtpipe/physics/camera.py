"""The camera: what averaging over the exposure and sampling once a frame make of a motion.

Everything is for one overdamped (Ornstein–Uhlenbeck) mode of variance s² and relaxation time τ,
seen as y_j = (1/W) ∫ x dt over the exposure W at the start of each frame of length D ≥ W. The
expressions are exact for any τ, any 0 < W ≤ D and all aliases (PHYSICS section 1); motions of
several modes are sums. Spectra are one-sided, per Hz. All functions broadcast over their arguments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mtpipe.ground.types import FloatArray

# Largest exposure over relaxation time in the formula: beyond, its powers overflow and nothing is
# left of the variance.
LONGEST = 1e30
# Coefficients of `white_deficit`, of α, α³, α⁵, …
_DEFICIT = tuple(2 / math.factorial(2 * j + 3) for j in range(10))


@dataclass(frozen=True)
class Camera:
    """Frame interval D and exposure W, in s.

    An exposure of zero is an instantaneous sample.
    """

    frame_s: float
    exposure_s: float

    def __post_init__(self) -> None:
        if not self.frame_s > 0:
            raise ValueError(f"the frame interval must be positive, got {self.frame_s} s")
        if not 0 <= self.exposure_s <= self.frame_s * 1.001:
            raise ValueError(
                f"the exposure must lie between 0 and the frame interval {self.frame_s:g} s, "
                f"got {self.exposure_s:g} s"
            )

    @property
    def nyquist_hz(self) -> float:
        """Half the frame rate."""
        return 0.5 / self.frame_s


def blur_factor(alpha: ArrayLike) -> FloatArray:
    """Variance of a blurred sample over s²: 2 (α − 1 + e^−α)/α², α = W/τ.

    Source: Wong & Halvorsen 2006, Eq 4; Savin & Doyle 2005.
    """
    # beyond, its powers overflow, and nothing is left of the variance
    a = np.minimum(np.asarray(alpha, dtype=float), LONGEST)
    small = a < 0.1
    safe = np.where(small, 1.0, a)
    exact = np.asarray(2 * (safe + np.expm1(-safe)) / safe**2)
    if not small.any():
        return exact
    # 2 Σ (−α)^j/(j+2)!: the closed form cancels for short exposures
    series = 1 - a / 3 * (1 - a / 4 * (1 - a / 5 * (1 - a / 6 * (1 - a / 7 * (1 - a / 8)))))
    return np.asarray(np.where(small, series, exact))


def edge_factor(alpha: ArrayLike) -> FloatArray:
    """Correlation of a blurred sample with the position at its exposure's edge: (1 − e^−α)/α."""
    a = np.asarray(alpha, dtype=float)
    safe = np.where(a == 0, 1.0, a)
    return np.where(a == 0, 1.0, -np.expm1(-safe) / safe)


def frame_variance(variance: ArrayLike, tau_s: ArrayLike, camera: Camera) -> FloatArray:
    """Variance c₀ of the recorded positions, in units of `variance`."""
    return np.asarray(variance, dtype=float) * blur_factor(camera.exposure_s / np.asarray(tau_s))


def lag_one_covariance(variance: ArrayLike, tau_s: ArrayLike, camera: Camera) -> FloatArray:
    """Covariance c₁ of successive recorded positions; c_m = c₁ exp(−(m−1) D/τ) for m ≥ 1."""
    tau = np.asarray(tau_s, dtype=float)
    edge = edge_factor(camera.exposure_s / tau)
    dead = np.exp(-(camera.frame_s - camera.exposure_s) / tau)
    return np.asarray(variance, dtype=float) * edge**2 * dead


def following(tau_s: ArrayLike, camera: Camera) -> FloatArray:
    """Mean square step over two frames over that over one, less 1: e^{−D/τ} for short exposures.

    (c₁ − c₂)/(c₀ − c₁), which slow drift of the recorded positions hardly changes.
    """
    tau = np.asarray(tau_s, dtype=float)
    alone, next_one = (of(1.0, tau, camera) for of in (frame_variance, lag_one_covariance))
    return np.asarray(next_one * -np.expm1(-camera.frame_s / tau) / (alone - next_one))


def mean_variance(
    variance: ArrayLike, tau_s: ArrayLike, camera: Camera, frames: int | NDArray[np.int64]
) -> FloatArray:
    """Variance of the mean of `frames` recorded positions in a row, in units of `variance`.

    [c₀ + 2 Σ_{m<N} (1 − m/N) c_m]/N: for long recordings the spectrum at zero frequency over twice
    their duration, aliases and all.
    """
    decay = -camera.frame_s / np.asarray(tau_s, dtype=float)
    gone = -np.expm1(decay)
    later = (1 + np.expm1(frames * decay) / (frames * gone)) / gone
    alone, next_one = (of(variance, tau_s, camera) for of in (frame_variance, lag_one_covariance))
    return np.asarray((alone + 2 * next_one * later) / frames)


def white_deficit(alpha: ArrayLike) -> FloatArray:
    """2 (sinh α − α)/α²: the white part that blur takes from the spectrum (form B), α ≤ 1."""
    a = np.asarray(alpha, dtype=float)
    square = a * a
    # 2 Σ α^(2j+1)/(2j+3)!: the closed form cancels for short exposures
    series = np.full_like(a, _DEFICIT[-1])
    for factor in _DEFICIT[-2::-1]:
        series *= square
        series += factor
    return np.asarray(a * series)


def edge_gain(alpha: ArrayLike) -> FloatArray:
    """h² with h = sinh(α/2)/(α/2), the gain of the correlated part (form B), α ≤ 1."""
    half = np.asarray(alpha, dtype=float) / 2
    safe = np.where(half == 0, 1.0, half)
    return np.where(half == 0, 1.0, np.sinh(safe) / safe) ** 2


def recorded_parts(tau_s: ArrayLike, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """How much of a recorded mode of unit variance is white, and how much is correlated.

    A mode that outlasts a frame, τ ≥ D, is recorded as the second times e^{−|m|D/τ} at all lags m
    (form B); a faster one as the second times e^{−(|m|−1)D/τ} at all lags but 0 (form A).
    """
    tau = np.asarray(tau_s, dtype=float)
    slow = tau >= camera.frame_s
    alpha = np.where(slow, camera.exposure_s / tau, 0.0)
    white, correlated = -white_deficit(alpha), edge_gain(alpha)
    if not slow.all():
        white = np.where(slow, white, frame_variance(1.0, tau, camera))
        correlated = np.where(slow, correlated, lag_one_covariance(1.0, tau, camera))
    return white, correlated


def power_spectrum(
    frequency_hz: ArrayLike, variance: ArrayLike, tau_s: ArrayLike, camera: Camera
) -> FloatArray:
    """One-sided spectrum of the recorded positions, blurred and with all aliases.

    Parameters
    ----------
    frequency_hz : 0 to Nyquist.
    variance : s², e.g. kT/k in nm².
    tau_s : relaxation time γ/k.

    Returns
    -------
    In units of `variance` per Hz; ∫ S df from 0 to Nyquist is `frame_variance`.

    Source: PHYSICS section 1, forms A (τ < D) and B; for W = D identical to twice the two-sided
    Eq 7 of Lansdorp & Saleh 2012; for W → 0 to Berg-Sørensen & Flyvbjerg 2004.
    """
    f, s2, tau = (np.asarray(one, dtype=float) for one in (frequency_hz, variance, tau_s))
    half_sine = np.sin(np.pi * f * camera.frame_s) ** 2
    decay = -camera.frame_s / tau
    q, one_minus_q = np.exp(decay), -np.expm1(decay)
    denominator = one_minus_q**2 + 4 * q * half_sine
    decaying = np.where(
        tau >= camera.frame_s, -np.expm1(2 * decay), 2 * (one_minus_q - 2 * half_sine)
    )
    white, correlated = recorded_parts(tau, camera)
    power = white + correlated * decaying / denominator
    return np.asarray(2 * camera.frame_s * s2 * power)
