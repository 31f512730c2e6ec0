"""The description of an experiment: plain immutable numbers, in the order of things in a recording.

Dynamics (tether, bead, fluid, field) → exposure of a frame → stage and reference beads → optics →
tracker → clock. Expected spectra, simulators and the design of experiments all read an
`Experiment`, so they cannot be given different physics; an effect is a change of it
(`dataclasses.replace`). What is only estimated, with its standard error, lives in
`mtpipe.conditions`; here every value is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.tether import Chain

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Fluid:
    """The buffer; `wall` says whether the surface raises its friction (Faxén, Brenner)."""

    temperature_K: float
    viscosity_mPa_s: float
    wall: bool = True

    @property
    def thermal_energy_pN_nm(self) -> float:
        """kT."""
        return float(thermal_energy_pN_nm(self.temperature_K))


@dataclass(frozen=True)
class Bead:
    """A tethered bead; `turns`: its rotation about the field's axis couples to its motion."""

    radius_nm: float
    turns: bool = True


@dataclass(frozen=True)
class Stage:
    """Motion shared by all beads: a steady drift and a random walk, along x, y, z."""

    steady_nm_per_s: Triple = (0.0, 0.0, 0.0)
    random_nm_per_root_s: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Optics:
    """What turns positions into recorded ones; `z_zero_nm` is added to every height."""

    z_zero_nm: float = 0.0


@dataclass(frozen=True)
class Tracker:
    """White noise of a tracked position per frame, along x, y, z, of tethered and reference beads.

    `lost_share` of the frames of each bead are lost, at random.
    """

    noise_nm: Triple = (0.0, 0.0, 0.0)
    reference_noise_nm: Triple = (0.0, 0.0, 0.0)
    lost_share: float = 0.0


@dataclass(frozen=True)
class Rest:
    """A plateau: the magnets rest at a position, and pull with a force for so many frames."""

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
