"""Exact simulation of a relaxation mode seen by a camera: one step per frame, no small time steps.

Over an exposure the position at its end and the integral over it are jointly Gaussian given the
position at its start; the dead time until the next frame is one more Gaussian step (PHYSICS section
1, last point; Gillespie 1996). This shares no formula with the spectra of `physics.camera`, so each
is a check on the other.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import signal

from mtpipe.physics.camera import Camera, FloatArray
from mtpipe.physics.modes import SINGLE_MODE, Modes


def simulate_mode(
    variance: float, tau_s: float, camera: Camera, frames: int, random: np.random.Generator
) -> FloatArray:
    """Recorded positions of one Ornstein–Uhlenbeck mode in equilibrium.

    Parameters
    ----------
    variance : s², e.g. kT/k in nm². tau_s : relaxation time γ/k.
    camera : frame interval and exposure; the exposure may not be zero.
    frames : how many.

    Returns
    -------
    (frames,) positions averaged over each exposure.
    """
    exposure, dead = camera.exposure_s, camera.frame_s - camera.exposure_s
    a = exposure / tau_s
    decay = math.exp(-a)
    if a < 1e-2:
        integral_variance = tau_s**2 * (2 * a**3 / 3 - a**4 / 2 + 7 * a**5 / 30)
    else:
        integral_variance = tau_s**2 * (2 * a - 3 + 4 * decay - decay**2)
    end_variance = -math.expm1(-2 * a)
    slope = tau_s * math.expm1(-a) ** 2 / end_variance
    rest = math.sqrt(max(integral_variance - slope**2 * end_variance, 0.0))
    end = math.sqrt(end_variance) * random.normal(size=frames)
    integral = slope * end + rest * random.normal(size=frames)
    dead_decay = math.exp(-dead / tau_s)
    kicks = dead_decay * end
    if dead > 0:
        kicks += math.sqrt(-math.expm1(-2 * dead / tau_s)) * random.normal(size=frames)
    start = np.empty(frames)
    start[0] = random.normal()
    carried = decay * dead_decay
    start[1:] = signal.lfilter([1.0], [1.0, -carried], kicks[:-1], zi=[carried * start[0]])[0]
    mean = -tau_s * math.expm1(-a) * start
    return np.asarray(math.sqrt(variance) * (mean + integral) / exposure)


def simulate_axis(
    stiffness_pN_per_nm: float,
    friction_pN_s_per_nm: float,
    thermal_energy_pN_nm: float,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    *,
    modes: Modes = SINGLE_MODE,
) -> FloatArray:
    """(frames,) recorded positions in nm along one axis of a tethered bead, without noise."""
    variance = thermal_energy_pN_nm / stiffness_pN_per_nm
    tau_s = friction_pN_s_per_nm / stiffness_pN_per_nm
    parts = [
        simulate_mode(share * variance, tau_s / rate, camera, frames, random)
        for share, rate in zip(modes.shares, modes.rates, strict=True)
    ]
    return np.asarray(np.sum(parts, axis=0))
