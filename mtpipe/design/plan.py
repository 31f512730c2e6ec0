"""An experiment as planned: what will be done, and how well its numbers will be known."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

from scipy import stats

from mtpipe.calibration.free_fits import NOISE_FACTOR
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.experiment.recorded_modes import BeadState
from mtpipe.experiment.state import bead_state
from mtpipe.ground.errors import SetupError
from mtpipe.ground.notice import Notice
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.tether import Chain, moments
from mtpipe.setup.conditions import FRICTION_ALLOWANCE, conditions_of
from mtpipe.setup.setup import Setup

# Below the force at which the bead would be under the surface for this share of the time, were
# there none, the surface pushes the bead and kT L/F is no longer its variance.
CONTACT_SHARE = 0.001
LOWEST_PN = 1e-3
# Smith, Cui & Bustamante 1996, Science 271:795.
OVERSTRETCHING_PN = 65.0
# Notices of the setup that concern a plan as well as a recording.
ABOUT_PLANS = ("temperature_assumed", "viscosity_assumed", "noise_assumed")


@dataclass(frozen=True)
class Knowledge:
    """Relative standard errors of what the setup states.

    `noise_factor`: the tracking noise is known within this factor (68 %); None: not at all.
    """

    radius: float
    viscosity: float
    exposure: float
    temperature: float
    noise_factor: float | None

    @property
    def friction(self) -> float:
        """Of the friction expected from radius, viscosity and height."""
        return math.hypot(self.radius, self.viscosity, FRICTION_ALLOWANCE)


@dataclass(frozen=True)
class Plan:
    """A planned experiment, one plateau long; its force is what is asked about."""

    experiment: Experiment
    knowledge: Knowledge

    @property
    def frames(self) -> int:
        """Frames of a plateau."""
        return self.experiment.rests[0].frames

    @property
    def duration_s(self) -> float:
        """Length of a plateau."""
        return self.frames * self.experiment.camera.frame_s

    def with_frames(self, frames: int) -> Plan:
        """The same plan with plateaus of another length."""
        rests = tuple(replace(rest, frames=frames) for rest in self.experiment.rests)
        return replace(self, experiment=replace(self.experiment, rests=rests))

    def state(self, force_pN: float) -> BeadState:
        """The bead at a force."""
        return _state(self.experiment, force_pN)

    def nyquist_ratio(self, force_pN: float) -> float:
        """Corner frequency along the field over the Nyquist frequency."""
        state = self.state(force_pN)
        rate = float(state.motion.stiffness[0, 0] / state.motion.friction[0, 0])
        return rate / math.pi * self.experiment.camera.frame_s

    def touches(self, force_pN: float) -> bool:
        """Whether the surface would push the bead more often than `CONTACT_SHARE`.

        By the chain alone: a bead that slack has no state.
        """
        return _touches(self.experiment.chain, self.experiment.bead.turns, force_pN)

    @functools.cached_property
    def lowest_force_pN(self) -> float:
        """The force below which the bead touches the surface, to 1 %; inf if it always does."""
        high = OVERSTRETCHING_PN
        if self.touches(high):
            return math.inf
        low = LOWEST_PN
        if not self.touches(low):
            return low
        while high > 1.01 * low:
            middle = math.sqrt(low * high)
            low, high = (middle, high) if self.touches(middle) else (low, middle)
        return high


@functools.lru_cache(maxsize=8192)
def _touches(chain: Chain, tilts: bool, force_pN: float) -> bool:
    energy = float(thermal_energy_pN_nm(chain.temperature_K))
    sinks = energy / (2 * force_pN) if tilts else 0.0
    end = moments(chain, force_pN)
    height, spread = float(end.height_nm) - sinks, math.sqrt(float(end.variance_nm2))
    return bool(stats.norm.cdf(-height / spread) > CONTACT_SHARE)


@functools.lru_cache(maxsize=8192)
def _state(experiment: Experiment, force_pN: float) -> BeadState:
    return bead_state(experiment, force_pN)


def plan_of(setup: Setup, frames: int) -> tuple[Plan, tuple[Notice, ...]]:
    """The plan that a setup describes.

    Parameters
    ----------
    frames : of each plateau.

    Returns
    -------
    The plan, and notices of what was assumed.

    Raises
    ------
    SetupError : something that a plan needs is unknown.
    """
    needed = {
        "[camera] frame_rate_hz": setup.camera.frame_rate_hz,
        "[camera] exposure_s": setup.camera.exposure_s,
        "[beads] radius_nm": setup.beads.radius_nm,
        "[tether] contour_length_nm": setup.tether.contour_length_nm,
        "[tether] persistence_length_nm": setup.tether.persistence_length_nm,
    }
    unknown = [key for key, measured in needed.items() if not measured.known]
    if unknown:
        be = "is" if len(unknown) == 1 else "are"
        raise SetupError(
            f'{" and ".join(unknown)} {be} "unknown", and the design needs a value',
            mend="Write the one you plan with.",
        )
    if frames < 2 * 64:
        raise SetupError(f"{frames} frames are too few for a plateau; at least 128 are needed")
    experiment, notices = experiment_of(setup, [1.0], frames)
    # methods are compared on the motion by expansion, which all of them mean
    experiment = replace(experiment, anharmonic=False)
    conditions, _ = conditions_of(setup)
    radius, viscosity = setup.beads.radius_nm, conditions.viscosity_mPa_s
    knowledge = Knowledge(
        radius=radius.relative_stderr,
        viscosity=viscosity[1] / viscosity[0],
        exposure=conditions.exposure_stderr_s / conditions.exposure_s,
        temperature=conditions.temperature_relative_stderr,
        noise_factor=NOISE_FACTOR if setup.beads.reference else None,
    )
    return Plan(experiment, knowledge), tuple(n for n in notices if n.code in ABOUT_PLANS)
