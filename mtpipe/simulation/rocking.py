"""Stretches of a bead that rocks: modes and the tether's length, which they share, step by step.

A tilt stretches the tether, so no mode is the motion of its length alone, and the length is far
from harmonic. A step solves the harmonic motion exactly, with the mean over it; what the chain
pulls with beyond that is taken as it is where the step begins (an exponential integrator).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from mtpipe.experiment.recorded_modes import BeadState, Rocking
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera, edge_factor
from mtpipe.physics.langevin import mean_variance_given_start

# Longest step, over the relaxation time of the tether's length alone, and most steps per exposure:
# more average the skewness of the length away.
STEP_RELAXATIONS, MOST_STEPS = 0.2, 24
# Density over its largest below which the length is never found, and no pull is computed.
LEAST_DENSITY = 1e-6
MOST_KNOWN = 512


def simulate_rocking(
    state: BeadState,
    rocking: Rocking,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    start: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """(frames, 3) motion, z from the surface, and the modes at its end.

    Parameters
    ----------
    start : the modes; None: drawn from equilibrium, as if it were harmonic.
    """
    from mtpipe.simulation.rocking_steps import follow

    plan = _plan(state, rocking, camera)
    begun = random.standard_normal(len(plan.stretch)) if start is None else start
    recorded, end = follow(
        begun,
        frames,
        plan.exposed,
        *plan.steps,
        state.modes.amplitude_nm,
        plan.stretch,
        plan.bends,
        plan.push_pN,
        plan.lowest_nm,
        plan.nodes_per_nm,
        random,
    )
    recorded[:, 2] += state.extension_nm - 0.5 * np.trace(plan.bends)
    return recorded, end


# Decay, spread, average, slope, rest, push and its mean; each (parts, d).
Steps = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class _Plan:
    """What of a state and a camera does not change; see `rocking_steps.follow`."""

    exposed: int
    steps: Steps
    stretch: FloatArray
    bends: FloatArray
    push_pN: FloatArray
    lowest_nm: float
    nodes_per_nm: float


@functools.lru_cache(maxsize=MOST_KNOWN)
def _plan(state: BeadState, rocking: Rocking, camera: Camera) -> _Plan:
    modes, motion, axial = state.modes, state.motion, state.axial
    stretch = rocking.stretch @ modes.shape
    step_s = STEP_RELAXATIONS * float(axial.modes[0][0])
    exposed = min(max(math.ceil(camera.exposure_s / step_s), 1), MOST_STEPS)
    dead_s = camera.frame_s - camera.exposure_s
    dark = min(math.ceil(dead_s / step_s), MOST_STEPS) if dead_s > 0 else 0
    lengths_s = np.repeat([camera.exposure_s / exposed, dead_s / max(dark, 1)], [exposed, dark])
    # what 1 pN on the length does to each mode, per second
    driven = np.linalg.solve(modes.shape, np.linalg.solve(motion.friction, rocking.stretch))
    a = lengths_s[:, None] / modes.tau_s
    decay, fallen = np.exp(-a), -np.expm1(-a)
    spread = np.sqrt(-np.expm1(-2 * a))
    average = edge_factor(a)
    slope = spread * np.tanh(a / 2) / np.maximum(a, 1e-8)
    of_mean = np.vectorize(mean_variance_given_start)(a)
    rest = np.sqrt(np.maximum(of_mean - slope**2, 0.0))
    still = driven * modes.tau_s
    steps = (decay, spread, average, slope, rest, fallen * still, (1 - average) * still)
    # the chain's pull beyond that of the spring, at lengths as they are in the harmonic motion
    length = axial.height_nm - axial.mean_nm
    spread_nm = float(np.linalg.norm(stretch))
    own = math.sqrt(float(axial.modes[1].sum()))
    there = axial.density > LEAST_DENSITY * axial.density.max()
    place = length[there] * spread_nm / own
    energy = axial.thermal_energy_pN_nm
    push = energy * (np.gradient(np.log(axial.density[there]), place) + place / spread_nm**2)
    return _Plan(
        exposed,
        steps,
        stretch,
        modes.quadratic(state.bending),
        push,
        float(place[0]),
        1 / float(place[1] - place[0]),
    )
