"""Beads on linear springs, step by step: the simulator of te Velthuis et al. 2010.

Their Brownian dynamics (Biophys J 99:1292, Methods): the overdamped Langevin equation
γ dx/dt = -k x + thermal force along each axis, in explicit Euler steps, then an emulated camera
that averages over the exposure. Axes are independent, so one axis is one spring. Slow, approximate
and without any formula in common with the exact simulator and the closed-form spectra, which makes
it the referee for both.

An Euler step of dt makes the variance kT/k too large by dt k/(2 γ) and the relaxation time too
short by the same fraction; the spectrum at low frequency is exact. A step for which that exceeds
1 % is refused. Every path starts in equilibrium.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.simulation.steps import divide_frame

PAPER_TIME_STEP_S = 5e-6
"""The time step of te Velthuis et al. 2010."""

LARGEST_BIAS = 0.01
"""Relative excess of the variance above which a time step is refused."""


def simulate_springs(
    stiffness_pN_per_nm: ArrayLike,
    friction_pN_s_per_nm: ArrayLike,
    thermal_energy_pN_nm: float,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    *,
    time_step_s: float = PAPER_TIME_STEP_S,
) -> FloatArray:
    """Recorded positions of beads on springs.

    Parameters
    ----------
    stiffness_pN_per_nm, friction_pN_s_per_nm : (n,) or numbers; broadcast against each other.
    thermal_energy_pN_nm : kT.
    time_step_s : the longest step; a frame is a whole number of equal ones (`divide_frame`).

    Returns
    -------
    (frames, n) positions in nm about each spring's rest, averaged over each exposure.

    Raises
    ------
    ValueError : a stiffness or friction that is not positive; a step so long that it makes a
        variance more than 1 % too large.
    """
    steps = divide_frame(camera, time_step_s)
    decay, kick, start = _euler(
        stiffness_pN_per_nm, friction_pN_s_per_nm, thermal_energy_pN_nm, steps.time_step_s, random
    )
    return _recorded(decay, kick, start, frames, steps.per_frame, steps.exposed, random)


def simulate_path(
    stiffness_pN_per_nm: ArrayLike,
    friction_pN_s_per_nm: ArrayLike,
    thermal_energy_pN_nm: float,
    steps: int,
    random: np.random.Generator,
    *,
    time_step_s: float = PAPER_TIME_STEP_S,
) -> FloatArray:
    """Every step of beads on springs, before any camera.

    With the step of `divide_frame` and the same random numbers, means of this path over each
    exposure are what `simulate_springs` returns.

    Parameters, raises: as `simulate_springs`; the step is exactly the one given.

    Returns
    -------
    (steps, n) positions in nm.
    """
    decay, kick, start = _euler(
        stiffness_pN_per_nm, friction_pN_s_per_nm, thermal_energy_pN_nm, time_step_s, random
    )
    return _recorded(decay, kick, start, steps, 1, 1, random)


def _euler(
    stiffness_pN_per_nm: ArrayLike,
    friction_pN_s_per_nm: ArrayLike,
    thermal_energy_pN_nm: float,
    time_step_s: float,
    random: np.random.Generator,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What is left of a position after one step, its kick, and a start; (n,) each."""
    stiffness, friction = np.broadcast_arrays(
        np.atleast_1d(np.asarray(stiffness_pN_per_nm, dtype=np.float64)),
        np.atleast_1d(np.asarray(friction_pN_s_per_nm, dtype=np.float64)),
    )
    if not (np.all(stiffness > 0) and np.all(friction > 0)):
        raise ValueError("stiffness and friction must be positive")
    step = time_step_s * stiffness / friction
    if step.max() / 2 > LARGEST_BIAS:
        limit = 2 * LARGEST_BIAS * np.min(friction / stiffness)
        raise ValueError(
            f"a time step of {time_step_s:.3g} s makes the variance of the stiffest spring "
            f"{step.max() / 2:.1%} too large: take at most {limit:.3g} s"
        )
    kick = np.sqrt(2 * thermal_energy_pN_nm * time_step_s / friction)
    # the variance the steps themselves keep: 1/(1 - step/2) of kT/k
    spread = np.sqrt(thermal_energy_pN_nm / stiffness / (1 - step / 2))
    return 1 - step, kick, spread * random.standard_normal(len(step))


@compiled
def _recorded(
    decay: FloatArray,
    kick: FloatArray,
    start: FloatArray,
    frames: int,
    per_frame: int,
    exposed: int,
    random: np.random.Generator,
) -> FloatArray:
    position = start.copy()
    recorded = np.zeros((frames, len(position)))
    for frame in range(frames):
        for step in range(per_frame):
            if step < exposed:
                recorded[frame] += position
            for i in range(len(position)):
                position[i] = decay[i] * position[i] + kick[i] * random.standard_normal()
        recorded[frame] /= exposed
    return recorded
