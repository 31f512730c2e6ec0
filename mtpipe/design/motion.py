"""One axis of a planned experiment at one force: its motion, its spectrum, its lever.

Axes are 0 (x) and 1 (y) of the camera. Everything comes from the experiment's own state.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.design.force_error import ForceError
from mtpipe.design.plan import Plan
from mtpipe.experiment.state import expected_spectrum
from mtpipe.fit.trace import LEAKAGE
from mtpipe.physics.modes import Modes
from mtpipe.physics.tethered_bead import lever_nm
from mtpipe.spectra.spectrum import Spectrum, periodogram, prewhitening

# Relaxation times this close share a prewhitening: any does that makes the spectrum about flat.
PREWHITENING_STEP_LN = 1.5


@dataclass(frozen=True)
class AxisMotion:
    """Stiffness pN/nm, friction pN s/nm and modes of a bead's motion along one axis."""

    stiffness: float
    friction: float
    modes: Modes
    variance_nm2: float

    @property
    def tau_s(self) -> float:
        """Relaxation time γ/k."""
        return self.friction / self.stiffness


def axis_motion(plan: Plan, force_pN: float, axis: int) -> AxisMotion:
    """The motion along x or y, from the normal modes."""
    state = plan.state(force_pN)
    motion, modes = state.motion, state.modes
    readout = motion.readout[axis]
    powers = modes.amplitude_nm[axis] ** 2
    variance = float(powers.sum())
    stiffness = plan.experiment.fluid.thermal_energy_pN_nm / variance
    friction = float(1 / (readout @ np.linalg.solve(motion.friction, readout)))
    seen = [(p / variance, tau) for p, tau in zip(powers, modes.tau_s, strict=True) if p > 0]
    return AxisMotion(
        stiffness,
        friction,
        Modes(
            tuple(float(share) for share, _ in seen),
            tuple(float(friction / (stiffness * tau)) for _, tau in seen),
        ),
        variance,
    )


def empty_spectrum(plan: Plan, motion: AxisMotion) -> Spectrum:
    """The periodogram of a complete trace of the plan's length, but for the data.

    Its window says what a model expects; prewhitened where the fit would do that.
    """
    frame_s = plan.experiment.camera.frame_s
    leaks = motion.tau_s / plan.duration_s * math.sqrt(plan.frames) > LEAKAGE
    steps = round(math.log(motion.tau_s / frame_s) / PREWHITENING_STEP_LN)
    phi = prewhitening(math.exp(steps * PREWHITENING_STEP_LN), 1.0) if leaks else 0.0
    one = _per_frame(plan.frames, phi)
    return replace(
        one,
        frequency_hz=one.frequency_hz / frame_s,
        window=replace(one.window, frame_s=frame_s),
        variance_nm2=motion.variance_nm2,
    )


@functools.lru_cache(maxsize=64)
def _per_frame(frames: int, phi: float) -> Spectrum:
    """With the frame as unit of time: what a window computes at length depends on no other."""
    # any trace without gaps has this window; an impulse moves at all frequencies alike
    return periodogram(np.arange(frames) == frames // 2, 1.0, phi=phi)


def common_errors(plan: Plan, force_pN: float, axis: int) -> ForceError:
    """What enters any force by the lever and kT, in `tilt`, `lever` and `temperature`.

    The lever is taken from the mean of z: where the bead tilts it is short of the tether's end by
    kT/2F. Its error is that of the mean of a slow motion, and across the field the radius's.
    """
    state, along = plan.state(force_pN), axis == plan.experiment.along
    radius = plan.experiment.bead.radius_nm
    lever = float(lever_nm(state.extension_nm, radius, along=along))
    true = force_pN / axis_motion(plan, force_pN, axis).stiffness
    slow = float(expected_spectrum(0.0, state, plan.experiment, 2)) / (2 * plan.duration_s)
    of_radius = 0.0 if along else plan.knowledge.radius * radius
    return ForceError(
        tilt=lever / true - 1,
        lever=math.hypot(math.sqrt(slow), of_radius) / lever,
        temperature=plan.knowledge.temperature,
    )
