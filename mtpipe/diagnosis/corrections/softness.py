"""A tether that is softer at some heights: what steps from frame to frame show of it.

Heights are distributed as if a curved look-up table had read them. How far the bead moves within a
frame depends less on it, the less the longer the tether takes to relax.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import gaussian_filter1d

from mtpipe.diagnosis.corrections.height_curve import (
    SHARES,
    Curve,
    fast_by_height,
    share_of_way,
    standardised,
)
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera, following

# Simulations of either tether: the mean of their steps is known to a fifth of their spread.
SIMULATIONS = 24
# Relaxation times, in frames, among which that of the heights is found.
RELAXATION_FRAMES = np.geomspace(0.05, 1000.0, 400)
# Heights of a tether that is softer at some of them: number of frames, farthest from the mean and
# width over which the bumps of the density of noisy quantiles are smoothed (standard deviations),
# longest step (relaxation times), fewest steps of a frame.
FRAMES, FARTHEST, SMOOTH, LARGEST_STEP, FEWEST_STEPS = 4000, 5.0, 0.25, 0.05, 10


def steps_of_softness(
    curve: Curve, z: FloatArray, camera: Camera, random: np.random.Generator
) -> tuple[float, float]:
    """How much of what a curve of the table does to steps a tether does that is softer where the
    table would be steep, and gives the same distribution: by simulation (`tether_like`), as how far
    the bead moves within a frame depends on the form of the curve; and the standard error.
    """
    tau_s = relaxation_s(z, camera)
    heights = [tether_like(None, tau_s, camera, random) for _ in range(SIMULATIONS)]
    softer = [tether_like(curve, tau_s, camera, random) for _ in range(SIMULATIONS)]
    straight = [standardised(one) for one in heights]
    each = np.array([np.quantile(one, SHARES) for one in straight])
    of_softer = np.mean([np.quantile(standardised(one), SHARES) for one in softer], axis=0)
    own = Curve(each.mean(axis=0), of_softer)
    share, stderr = share_of_way(
        np.mean([fast_by_height(standardised(one)) for one in softer], axis=0),
        np.array([fast_by_height(one) for one in straight]),
        np.array([fast_by_height(own.answered(one)) for one in straight]),
    )
    return share, stderr / math.sqrt(SIMULATIONS)


def tether_like(
    curve: Curve | None,
    tau_s: float,
    camera: Camera,
    random: np.random.Generator,
    frames: int = FRAMES,
) -> FloatArray:
    """(frames,) heights that are recorded of a bead on a spring that is softer where a curve is
    steep, so that they are distributed by it; None: a spring of one stiffness.

    Parameters
    ----------
    tau_s : relaxation time of the spring of one stiffness, whose standard deviation is 1.
    """
    # numba is loaded where something is simulated only
    from mtpipe.simulation.axial_steps import averaged_heights

    at = np.linspace(-FARTHEST, FARTHEST, 401)
    ln_density = -(at**2) / 2
    if curve is not None:
        heights = curve.undone(at)
        ln_density = np.log(np.gradient(heights, at)) - heights**2 / 2
        bumps = ln_density + at**2 / 2
        ln_density = gaussian_filter1d(bumps, SMOOTH / (at[1] - at[0]), mode="nearest") - at**2 / 2
    steps = max(math.ceil(camera.frame_s / (LARGEST_STEP * tau_s)), FEWEST_STEPS)
    step = camera.frame_s / steps / tau_s
    exposed = round(steps * camera.exposure_s / camera.frame_s)
    move, spread = np.gradient(ln_density, at) * step, np.full(len(at), math.sqrt(2 * step))
    begun = random.normal()
    found, _ = averaged_heights(
        move, spread, -FARTHEST, FARTHEST, begun, frames, steps, exposed, random
    )
    return found


def relaxation_s(z: FloatArray, camera: Camera) -> float:
    """Relaxation time of heights, by how frames follow each other."""
    able_s = RELAXATION_FRAMES * camera.frame_s
    return float(np.interp(following_of(z), following(able_s, camera), able_s))


def following_of(z: FloatArray) -> float:
    """Mean square step over two frames over that over one, less 1, as `physics.camera.following`.

    Noise makes it smaller, so that less is told apart.
    """
    one, two = (float(np.nanmean((z[by:] - z[:-by]) ** 2)) for by in (1, 2))
    return two / one - 1
