"""Expected power of exponential covariances seen through a window, compiled: fits ask for it most.

Importing this module imports numba.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray
from mtpipe.spectra.elementary import exponentials, logarithms
from mtpipe.spectra.recorded_mode import seen_mode

# A correlation of no more than this adds nothing to what is white.
NOTHING = 1e-18


@compiled
def of_one_mode(
    tau: float,
    white: float,
    correlated: float,
    of_white: FloatArray,
    of_lag: FloatArray,
    knots: FloatArray,
    cubics: FloatArray,
    power: FloatArray,
) -> None:
    """Expected binned periodogram, over 2D, of a mode of unit variance, into `power` (n_bins,).

    Parameters
    ----------
    tau : relaxation time over the frame interval.
    white, correlated : how much of the mode is which (`physics.camera.recorded_parts`).
    of_white : (n_bins,) what a window makes of white noise.
    of_lag : (lags, n_bins) what it makes of unit covariance at lag ±1, ±2, …
    knots, cubics : (k + 1,) and (4, k, n_bins) of the spline over ln τ, in equal steps, of the
        logarithm of what it makes of the covariance e^{−|m|/τ}.
    """
    bins = len(of_white)
    if tau >= 1:
        x = math.log(tau)
        at = int((x - knots[0]) / (knots[1] - knots[0]))
        at = min(max(at, 0), cubics.shape[1] - 1)
        x -= knots[at]
        for i in range(bins):
            ln = (cubics[0, at, i] * x + cubics[1, at, i]) * x + cubics[2, at, i]
            power[i] = ln * x + cubics[3, at, i]
        exponentials(power)
        for i in range(bins):
            power[i] = white * of_white[i] + correlated * power[i]
        return
    for i in range(bins):
        power[i] = white * of_white[i]
    decay, left = math.exp(-1 / tau), correlated
    for lag in range(len(of_lag)):
        if left < NOTHING:
            break
        for i in range(bins):
            power[i] += left * of_lag[lag, i]
        left *= decay


@compiled
def _add_modes(
    variance: FloatArray,
    tau_s: FloatArray,
    noise: float,
    frame_s: float,
    exposure_s: float,
    of_white: FloatArray,
    of_lag: FloatArray,
    knots: FloatArray,
    cubics: FloatArray,
    unit: FloatArray,
    power: FloatArray,
) -> None:
    """A motion of (modes,) into `power` (n_bins,); `unit` (n_bins,) is overwritten."""
    longest_s = frame_s * math.exp(knots[-1])
    for i in range(len(power)):
        power[i] = 2 * frame_s * noise * of_white[i]
    for mode in range(len(tau_s)):
        tau, white, correlated = seen_mode(tau_s[mode], longest_s, frame_s, exposure_s)
        of_one_mode(tau, white, correlated, of_white, of_lag, knots, cubics, unit)
        scale = 2 * frame_s * variance[mode]
        for i in range(len(power)):
            power[i] += scale * unit[i]


@compiled
def expected_powers(
    variance: FloatArray,
    tau_s: FloatArray,
    noise: FloatArray,
    frame_s: float,
    exposure_s: float,
    of_white: FloatArray,
    of_lag: FloatArray,
    knots: FloatArray,
    cubics: FloatArray,
) -> FloatArray:
    """(n, n_bins) expected binned periodograms of n motions along one axis, per Hz, one-sided.

    Parameters
    ----------
    variance, tau_s : (n, modes) of each motion's modes.
    noise : (n,) variance of white tracking noise.
    frame_s, exposure_s : of the camera. The others: as of `of_one_mode`.
    """
    powers, unit = np.empty((len(noise), len(of_white))), np.empty(len(of_white))
    for k in range(len(noise)):
        _add_modes(
            variance[k], tau_s[k], noise[k], frame_s, exposure_s,
            of_white, of_lag, knots, cubics, unit, powers[k],
        )  # fmt: skip
    return powers


@compiled
def log_likelihoods(
    measured: FloatArray,
    ordinates: FloatArray,
    variance: FloatArray,
    tau_s: FloatArray,
    noise: FloatArray,
    frame_s: float,
    exposure_s: float,
    of_white: FloatArray,
    of_lag: FloatArray,
    knots: FloatArray,
    cubics: FloatArray,
) -> FloatArray:
    """(n,) ln of the likelihood of a measured power (n_bins,), each bin with a Gamma law of shape
    `ordinates` (n_bins,), for n motions, up to a constant. The others: as of `expected_powers`.
    """
    out = np.empty(len(noise))
    power, unit = np.empty(len(of_white)), np.empty(len(of_white))
    for k in range(len(noise)):
        _add_modes(
            variance[k], tau_s[k], noise[k], frame_s, exposure_s,
            of_white, of_lag, knots, cubics, unit, power,
        )  # fmt: skip
        logarithms(power, unit)
        total = 0.0
        for i in range(len(power)):
            total -= ordinates[i] * (unit[i] + measured[i] / power[i])
        out[k] = total
    return out


@compiled
def power_matrices(
    first: NDArray[np.int64],
    tau: FloatArray,
    white: FloatArray,
    correlated: FloatArray,
    covariance: FloatArray,
    of_white: tuple[FloatArray, ...],
    of_lag: tuple[FloatArray, ...],
    knots: tuple[FloatArray, ...],
    cubics: tuple[FloatArray, ...],
) -> FloatArray:
    """(motions, n_bins, axes, axes) expected binned periodograms and what is common to two axes,
    over 2D.

    Parameters: as of `of_one_mode`, the first three (n,), the last four per axis.
    first : (motions + 1,) first mode of each motion, and one after the last.
    covariance : (n, axes, axes) of each mode.
    """
    motions, bins, axes = len(first) - 1, len(of_white[0]), covariance.shape[1]
    power = np.zeros((motions, bins, axes, axes))
    unit = np.empty((axes, bins))
    for motion in range(motions):
        for k in range(first[motion], first[motion + 1]):
            for a in range(axes):
                if covariance[k, a, a] != 0:
                    of_one_mode(
                        tau[k], white[k], correlated[k], of_white[a], of_lag[a], knots[a],
                        cubics[a], unit[a],
                    )  # fmt: skip
                    for i in range(bins):
                        power[motion, i, a, a] += covariance[k, a, a] * unit[a, i]
            for a in range(axes):
                for b in range(a):
                    if covariance[k, a, b] != 0:
                        for i in range(bins):
                            common = math.sqrt(unit[a, i] * unit[b, i])
                            power[motion, i, a, b] += covariance[k, a, b] * common
        for a in range(axes):
            for b in range(a):
                power[motion, :, b, a] = power[motion, :, a, b]
    return power


@compiled
def with_noise(
    power: FloatArray, added: FloatArray, of_white: tuple[FloatArray, ...], least: float
) -> FloatArray:
    """Power matrices (n, n_bins, axes, axes) with noise added to each axis, in place.

    Parameters
    ----------
    added : (n, n_bins, axes) the noise's power were it white there. of_white : per axis (n_bins,)
        what its window makes of white noise. least : no power is smaller than this share of the
        axis's largest.
    """
    motions, bins, axes = added.shape
    for motion in range(motions):
        for a in range(axes):
            largest = -math.inf
            for i in range(bins):
                power[motion, i, a, a] += added[motion, i, a] * of_white[a][i]
                largest = max(largest, power[motion, i, a, a])
            for i in range(bins):
                power[motion, i, a, a] = max(power[motion, i, a, a], least * largest)
    return power
