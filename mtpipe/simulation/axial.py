"""Heights of a bead in the chain's potential, stepped in time: one coordinate, few steps a frame.

A step solves the motion linearised at the bead's height exactly, so steps may be a fifth of the
relaxation time (local linearisation, Ozaki 1992). Where a frame holds too many relaxation times for
that, only the mean over the exposure is seen, which is nearly Gaussian: then the relaxation modes
are drawn, each exactly, and their sum is bent to the skewness that the mean has.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from scipy import interpolate, optimize

from mtpipe.ground.types import FloatArray
from mtpipe.physics.axial import AxialMotion
from mtpipe.physics.camera import Camera, frame_variance
from mtpipe.physics.langevin import mode_path

STEP_RELAXATIONS = 0.2
MOST_STEPS = 60
TABLE = 512
# A parabola of a Gaussian variable, monotonic where it matters, is no more skewed than this.
MOST_SKEWED = 1.5
# Size of the cache of states, for what is the same in all simulations. A plateau whose force
# changes has some two dozen, each in a few variants.
MOST_KNOWN = 2048


def simulate_heights(
    motion: AxialMotion,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    start_nm: float | None = None,
) -> tuple[FloatArray, float]:
    """Heights averaged over each exposure, and the height at the end of the last frame.

    Parameters
    ----------
    start_nm : height at the start; None: drawn from equilibrium.
    """
    tau_s, variance = motion.modes
    steps = math.ceil(camera.frame_s / (STEP_RELAXATIONS * float(tau_s[0])))
    if steps > MOST_STEPS and camera.exposure_s == 0:
        # with a frame of many relaxation times, instantaneous heights are independent
        return _drawn(motion, frames, random), motion.mean_nm
    if steps > MOST_STEPS:
        heights = np.zeros(frames)
        for tau, one in zip(tau_s, variance, strict=True):
            heights += math.sqrt(one) * mode_path(float(tau), camera, frames, random).averages[0]
        return motion.mean_nm + _bent(heights, *_averaged(motion, camera)), motion.mean_nm
    from mtpipe.simulation.axial_steps import averaged_heights

    steps = max(steps, 2)
    exposed = 0
    if camera.exposure_s > 0:
        exposed = max(1, round(steps * camera.exposure_s / camera.frame_s))
        # as in the spring simulator: whole steps in the exposure matter more than the step itself
        while abs(exposed * camera.frame_s / steps / camera.exposure_s - 1) > 0.01 and steps < 400:
            steps += 1
            exposed = max(1, round(steps * camera.exposure_s / camera.frame_s))
    low, high = float(motion.height_nm[0]), float(motion.height_nm[-1])
    move, spread = _tables(motion, camera.frame_s / steps)
    if start_nm is None:
        start_nm = float(_drawn(motion, 1, random)[0])
    heights, end = averaged_heights(
        move,
        spread,
        low,
        high,
        min(max(start_nm, low), high),
        frames,
        steps,
        exposed,
        random,
    )
    return heights, float(end)


def _drawn(motion: AxialMotion, count: int, random: np.random.Generator) -> FloatArray:
    """(count,) heights drawn from equilibrium; a node's share lies half a step to each side."""
    share = np.cumsum(motion.density)
    drawn = np.interp(random.random(count) * share[-1], share, motion.height_nm)
    return np.asarray(drawn + motion.step_nm / 2)


@functools.lru_cache(maxsize=MOST_KNOWN)
def _averaged(motion: AxialMotion, camera: Camera) -> tuple[float, float]:
    """Variance of heights averaged over an exposure, and the bend that makes a Gaussian series as
    skewed as they are.

    Of y = c (g + b (g² − σ²)) the variance is c² (σ² + 2 b² σ⁴), and the third cumulant
    c³ (6 b σ⁴ + 8 b³ σ⁶).
    """
    variance = sum(
        float(frame_variance(one, tau, camera)) for tau, one in zip(*motion.modes, strict=True)
    )
    if variance <= 0:
        return 0.0, 0.0
    third = motion.third_cumulant_nm3(camera.exposure_s)
    skewness = float(np.clip(third / variance**1.5, -MOST_SKEWED, MOST_SKEWED))
    bend = optimize.brentq(
        lambda b: (6 * b + 8 * b**3) / (1 + 2 * b**2) ** 1.5 - skewness, -0.5, 0.5
    )
    return variance, float(bend)


def _bent(gaussian: FloatArray, variance: float, bend: float) -> FloatArray:
    """A Gaussian series of this variance bent, its variance kept (`_averaged`)."""
    if bend == 0:
        return gaussian
    unit = gaussian / math.sqrt(variance)
    return np.asarray(math.sqrt(variance / (1 + 2 * bend**2)) * (unit + bend * (unit**2 - 1)))


@functools.lru_cache(maxsize=MOST_KNOWN)
def _tables(motion: AxialMotion, step_s: float) -> tuple[FloatArray, FloatArray]:
    """(TABLE,) mean move and spread of one step, at heights from the lowest to the highest."""
    table_nm = np.linspace(float(motion.height_nm[0]), float(motion.height_nm[-1]), TABLE)
    energy = motion.thermal_energy_pN_nm
    log_density = interpolate.CubicSpline(motion.height_nm, np.log(motion.density))
    mobility = interpolate.CubicSpline(motion.height_nm, motion.mobility_nm_per_s_pN)
    drift = energy * (mobility(table_nm) * log_density(table_nm, 1) + mobility(table_nm, 1))
    slope = np.gradient(drift, table_nm)
    a = np.clip(slope * step_s, -50.0, 1.0)
    safe = np.where(np.abs(a) > 1e-8, a, 1e-8)
    move = drift * step_s * np.expm1(safe) / safe
    # what the curvature of the drift adds to the mean (Shoji & Ozaki 1998, Stat Probab Lett 16:733)
    curve = np.gradient(slope, table_nm) * energy * mobility(table_nm)
    move += curve * step_s**2 * np.where(np.abs(a) > 1e-4, (np.expm1(safe) - safe) / safe**2, 0.5)
    square = 2 * energy * mobility(table_nm) * step_s * np.expm1(2 * safe) / (2 * safe)
    return np.asarray(move), np.sqrt(np.maximum(square, 0.0))
