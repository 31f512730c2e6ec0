"""The description of an experiment: plain immutable numbers, in the order of things in a recording.

Dynamics (tether, bead, fluid, field) → exposure of a frame → stage and reference beads → optics →
tracker → clock. Expected spectra, simulators and the design of experiments all read an
`Experiment`, so they cannot be given different physics; an effect is a change of it
(`dataclasses.replace`). What is only estimated, with its standard error, lives in
`mtpipe.setup.conditions`; here every value is exact.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Literal, Protocol, TypeGuard, TypeVar

import numpy as np
from numpy.typing import NDArray

from mtpipe.experiment.changed import changed
from mtpipe.experiment.step import Step, by_plateau
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.tether import Chain

Triple = tuple[float, float, float]
Force = TypeVar("Force", float, NDArray[np.float64])


@dataclass(frozen=True)
class Fluid:
    """The buffer; `wall` says whether the surface raises its friction (Faxén, Brenner).

    `memory`: hydrodynamic memory over that of a bead far from any surface; 0: friction is the same
    at every frequency.
    """

    temperature_K: float
    viscosity_mPa_s: float
    wall: bool = True
    memory: float = 0.0

    @property
    def thermal_energy_pN_nm(self) -> float:
        """kT."""
        return float(thermal_energy_pN_nm(self.temperature_K))


@dataclass(frozen=True)
class Bead:
    """A tethered bead.

    `turns`: its rotation about the field's axis couples to its motion. `offset_nm`: distance of the
    tether's attachment from the vertical through the bead's centre, at rest and towards the
    positive end of the field's axis, alike at all forces; 0: at its lowest point.
    `z_per_turn_nm`, `aside_per_turn_nm`: nm per radian by which the recorded height, and the
    recorded position across the field, follow its rotation about the field's axis, where its image
    turns with it (PHYSICS E25).
    """

    radius_nm: float
    turns: bool = True
    offset_nm: float = 0.0
    z_per_turn_nm: float = 0.0
    aside_per_turn_nm: float = 0.0

    @property
    def lever_nm(self) -> float:
        """Height of the bead's centre above the attachment."""
        return math.sqrt(self.radius_nm**2 - self.offset_nm**2)


@dataclass(frozen=True)
class ForceCourse:
    """How the force changes within a plateau.

    `relative_change`: from its first value to its last, over its mean in time. `kind`: a steady
    "ramp", an exponential "settling" with the time constant `at`, or a "step" at the time `at`,
    both in shares of the plateau.
    """

    relative_change: float = 0.0
    kind: Literal["ramp", "settling", "step"] = "ramp"
    at: float = 0.0


@dataclass(frozen=True)
class Magnets:
    """What the magnets do besides pulling.

    `alignment_pN_nm`: torque stiffness with which the field holds the bead's axis against tilting,
    at 1 pN; infinite where None. It goes with the force to the power `alignment_power`: 0, the
    field is much the same wherever the magnets are; 1, the bead is far from saturated.
    `sideways_per_nm`: lateral stiffness over force, in x and y. `courses`: of the force in each
    plateau; none at all where it is steady everywhere.
    """

    alignment_pN_nm: float | None = None
    alignment_power: float = 0.0
    sideways_per_nm: float = 0.0
    courses: tuple[ForceCourse, ...] = ()

    def alignment_at(self, force_pN: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """(…,) torque stiffness at forces (…,), pN nm; None where it is infinite."""
        if self.alignment_pN_nm is None:
            return None
        return np.asarray(self.alignment_pN_nm * force_pN**self.alignment_power)

    def sideways_at(self, force_pN: Force) -> Force:
        """Lateral stiffness at a force or forces, pN/nm."""
        return force_pN * self.sideways_per_nm

    def course(self, plateau: int) -> ForceCourse:
        """The force's course in a plateau."""
        return self.courses[plateau] if self.courses else ForceCourse()


@dataclass(frozen=True)
class Stage:
    """Slow motion and vibration, along x, y, z.

    Steady drift and random walk are shared by all beads and go with the reference. What
    subtraction leaves is `unsubtracted_nm_per_root_s`, a random walk of the bead's own, and the
    `reference_nm` by which the reference itself moves, for `reference_s` at a time.
    """

    steady_nm_per_s: Triple = (0.0, 0.0, 0.0)
    random_nm_per_root_s: Triple = (0.0, 0.0, 0.0)
    unsubtracted_nm_per_root_s: Triple = (0.0, 0.0, 0.0)
    reference_nm: Triple = (0.0, 0.0, 0.0)
    reference_s: float = 1.0
    lines: tuple[Line, ...] = ()

    @property
    def lines_hz(self) -> list[float]:
        """Frequencies of the vibrations."""
        return [line.frequency_hz for line in self.lines]


@dataclass(frozen=True)
class Line:
    """A vibration as recorded: its frequency in the file's rows, after aliasing, where frames are
    lost unseen its mean one, and its amplitude after blur.

    Its phase diffuses: the wave at one time and a time t later have e^(−t/coherence) in common.
    """

    frequency_hz: float
    amplitude_nm: Triple
    coherence_s: float = math.inf


@dataclass(frozen=True)
class Optics:
    """What turns positions into recorded ones.

    x and y are turned by an angle and scaled, by `lateral_scale` and each by its `axis_scales`;
    None: these are 1, and no form of a fault. z is scaled; then `z_zero_nm` is added to
    heights.
    """

    z_zero_nm: float = 0.0
    lateral_scale: float = 1.0
    axis_scales: tuple[float, float] | None = None
    axial_scale: float = 1.0
    angle_rad: float = 0.0

    @functools.cached_property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) recorded over true positions."""
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        x_scale, y_scale = self.axis_scales or (1.0, 1.0)
        seen = np.diag(
            [self.lateral_scale * x_scale, self.lateral_scale * y_scale, self.axial_scale]
        )
        found = np.asarray(seen @ turned)
        found.flags.writeable = False
        return found


@dataclass(frozen=True)
class Tracker:
    """White noise of a tracked position per frame, along x, y, z, of tethered and reference beads.

    `lost_share` of the frames of each bead are lost, at random.
    """

    noise_nm: Triple = (0.0, 0.0, 0.0)
    reference_noise_nm: Triple = (0.0, 0.0, 0.0)
    lost_share: float = 0.0


@dataclass(frozen=True)
class Clock:
    """`dropped_share` of the frames are missing, and the file counts on as if they were not."""

    dropped_share: float = 0.0


@dataclass(frozen=True)
class Allowance:
    """How far z's own motion is from what theory says: factors on its friction and its variance.

    One, but for fits and simulations that may not trust theory further than it holds: Brenner's
    series, the chain's formula and time steps of other simulators are good to some percent in z.
    """

    upward_friction: float = 1.0
    upward_variance: float = 1.0


class ChangeByPlateau(Protocol):
    """A step that is none of the readout: bead or tether are others in each plateau."""

    def changed_in(self, experiment: Experiment, plateau: int) -> Experiment:
        """The experiment as it is in one plateau."""


def changes_bead(step: Step | ChangeByPlateau) -> TypeGuard[ChangeByPlateau]:
    """Whether a step changes bead or tether from plateau to plateau."""
    return hasattr(step, "changed_in")


@dataclass(frozen=True)
class Rest:
    """A plateau: the magnets rest at a position and pull with a force for a number of frames."""

    force_pN: float
    frames: int
    magnet_mm: float


@dataclass(frozen=True)
class Experiment:
    """A whole recording, described.

    Attributes
    ----------
    chain : the tether, a potential about its anchor.
    along : axis of the camera along the field, 0 (x) or 1 (y).
    rests : plateaus in time order; between two the magnets move for `move_s`.
    tethered, references : how many beads; all tethered beads are alike.
    steps : what else is between motion and record, from effects' own files.
    anharmonic : at low force a bead that turns is followed through the whole of the tether's
        potential, down to the surface, and not by expansions about its mean.
    """

    chain: Chain
    bead: Bead
    fluid: Fluid
    along: int
    camera: Camera
    stage: Stage
    tracker: Tracker
    rests: tuple[Rest, ...]
    move_s: float = 1.0
    tethered: int = 1
    references: int = 1
    optics: Optics = Optics()
    magnets: Magnets = Magnets()
    steps: tuple[Step, ...] = ()
    clock: Clock = Clock()
    allowance: Allowance = Allowance()
    anharmonic: bool = False

    @property
    def varies(self) -> bool:
        """Whether plateaus differ in more than what the magnets do."""
        return any(by_plateau(step) or changes_bead(step) for step in self.steps)

    def in_plateau(self, plateau: int) -> Experiment:
        """The experiment as it is in one plateau, with the steps that it has there."""
        if not self.varies:
            return self
        steps = tuple(
            step.in_plateau(plateau) if by_plateau(step) else step
            for step in self.steps
            if not changes_bead(step)
        )
        here = changed(self, steps=steps)
        for step in self.steps:
            if changes_bead(step):
                here = step.changed_in(here, plateau)
        return here

    @property
    def rocks(self) -> bool:
        """Whether the bead tilts, and its tilt moves its height (PHYSICS E26)."""
        return self.magnets.alignment_pN_nm is not None and self.bead.offset_nm != 0
