"""Exact simulation of relaxation modes seen by a camera: one step per frame, no small time steps.

Over an exposure the position at its end and the integral over it are jointly Gaussian given the
position at its start; the dead time until the next frame is one more Gaussian step (PHYSICS section
1, last point; Gillespie 1996). This shares no formula with the spectra of `physics.camera`, so each
is a check on the other.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.physics.modes import SINGLE_MODE, Modes
from mtpipe.physics.normal_numbers import standard_normal

# Size of the cache of modes, for what is the same in all simulations. A plateau whose force changes
# has a hundred modes, in a few variants.
MOST_KNOWN = 8192


@dataclass(frozen=True, eq=False)
class ModePath:
    """One mode in units of its standard deviation.

    `averages` (parts, frames) are over equal parts of each exposure; `end` is the position at the
    start of the frame that would follow.
    """

    averages: FloatArray
    end: float


def mode_path(
    tau_s: float,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    *,
    start: float | None = None,
    parts: int = 1,
) -> ModePath:
    """Motion of one Ornstein–Uhlenbeck mode of unit variance.

    Parameters
    ----------
    tau_s : relaxation time γ/k. camera : frame interval and exposure. frames : how many.
    start : position at the start of the first exposure; None: drawn from equilibrium.
    parts : number of parts of each exposure, which are averaged one by one.
    """
    # numba is loaded where something is simulated only
    from mtpipe.physics.langevin_steps import follow

    kick = standard_normal(random, (parts, frames))
    average = standard_normal(random, (parts, frames))
    begun = float(random.standard_normal()) if start is None else start
    end = follow(kick, average, *_frame(tau_s, camera, parts), begun)
    return ModePath(average, float(end))


@functools.lru_cache(maxsize=MOST_KNOWN)
def _frame(
    tau_s: float, camera: Camera, parts: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float, float, float]:
    """What of a mode and a camera does not change from frame to frame (`langevin_steps.follow`)."""
    part_s, dead_s = camera.exposure_s / parts, camera.frame_s - camera.exposure_s
    a = part_s / tau_s
    decay, dead_decay = math.exp(-a), math.exp(-dead_s / tau_s)
    # what is drawn for a part moves where it ends and, of the last one, the dead time behind it
    end_variance = -math.expm1(-2 * a)
    moved = np.full(parts, end_variance)
    moved[-1] = dead_decay**2 * end_variance - math.expm1(-2 * dead_s / tau_s)
    # of the mean over a part, given the start: on x_end it depends by this, on what was drawn by
    # `slope`, and the rest is its own
    of_end = 0.5 * _tanhc(a / 2)
    slope = np.full(parts, of_end)
    slope[-1] *= dead_decay * end_variance / moved[-1]
    rest = np.sqrt(np.maximum(mean_variance_given_start(a) - slope**2 * moved, 0.0))
    carried_by = dead_decay * decay ** np.arange(parts - 1.0, -1.0, -1.0)
    whole = math.exp(-camera.frame_s / tau_s)
    return np.sqrt(moved), rest, slope, carried_by, decay, whole, _edge(a)


def _edge(a: float) -> float:
    """(1 − e^−a)/a."""
    return -math.expm1(-a) / a if a > 0 else 1.0


def _tanhc(a: float) -> float:
    """tanh(a)/a."""
    return math.tanh(a) / a if a > 1e-4 else 1 - a * a / 3


def mean_variance_given_start(a: float) -> float:
    """Variance of the mean of a mode over a stretch, its start given, in units of the mode's.

    Parameters
    ----------
    a : length of the stretch in relaxation times.
    """
    if a < 1e-2:
        return 2 * a / 3 - a**2 / 2 + 7 * a**3 / 30
    decay = math.exp(-a)
    return (2 * a - 3 + 4 * decay - decay**2) / a**2


def simulate_mode(
    variance: float, tau_s: float, camera: Camera, frames: int, random: np.random.Generator
) -> FloatArray:
    """(frames,) positions of one mode in equilibrium, averaged over each exposure.

    Parameters
    ----------
    variance : s², e.g. kT/k in nm². tau_s : relaxation time γ/k.
    """
    path = mode_path(tau_s, camera, frames, random)
    return np.asarray(math.sqrt(variance) * path.averages[0])


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
