"""Exact simulation of modes seen by a camera, for tests (PHYSICS section 1, last point).

Independent of the closed forms under test: it draws (position, integral over the exposure) jointly
from their Gaussian law and knows nothing of spectra.
"""

from __future__ import annotations

import numpy as np
from scipy import signal


def simulate_mode(variance, tau_s, frame_s, exposure_s, frames, rng):
    """(frames,) positions of one Ornstein–Uhlenbeck mode averaged over each exposure."""
    a = exposure_s / tau_s
    decay = np.exp(-a)
    if a < 1e-2:
        var_integral = tau_s**2 * (2 * a**3 / 3 - a**4 / 2 + 7 * a**5 / 30)
    else:
        var_integral = tau_s**2 * (2 * a - 3 + 4 * decay - decay**2)
    var_end = -np.expm1(-2 * a)
    covariance = tau_s * np.expm1(-a) ** 2
    slope = covariance / var_end
    rest = np.sqrt(max(var_integral - covariance * slope, 0.0))
    end = np.sqrt(var_end) * rng.normal(size=frames)
    integral_noise = slope * end + rest * rng.normal(size=frames)
    dead = np.exp(-(frame_s - exposure_s) / tau_s)
    gap_noise = np.sqrt(max(-np.expm1(-2 * (frame_s - exposure_s) / tau_s), 0.0))
    kicks = dead * end + gap_noise * rng.normal(size=frames)
    start = np.empty(frames)
    start[0] = rng.normal()
    start[1:] = signal.lfilter(
        [1.0], [1.0, -decay * dead], kicks[:-1], zi=[decay * dead * start[0]]
    )[0]
    mean = -tau_s * np.expm1(-a) * start
    return np.sqrt(variance) * (mean + integral_noise) / exposure_s


def simulate_trace(
    stiffness, friction, frame_rate_hz, exposure_s, frames, rng, *, kT=4.11, noise_nm=0.0
):
    """(frames,) positions in nm of a bead on a spring, with white tracking noise."""
    x = simulate_mode(
        kT / stiffness, friction / stiffness, 1 / frame_rate_hz, exposure_s, frames, rng
    )
    return x + noise_nm * rng.normal(size=frames)
