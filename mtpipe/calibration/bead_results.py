"""What the calibration of one bead found: results as plain frozen data."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mtpipe.fit.posterior import Posterior
from mtpipe.fit.trace import TraceFit
from mtpipe.ground.estimate import Estimate, Status
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import with_error
from mtpipe.recording.recording import Plateau
from mtpipe.recording.traces import Trace


@dataclass(frozen=True, repr=False)
class AxisResult:
    """Calibration of one bead, plateau and axis.

    `fit` and `posterior` are of the most informed fit the data support, which `method` names: of
    the bead's whole series, or of this trace by itself. `fit` is None where the trace could not be
    fitted (`refusal` says why). `posterior` is sampled on the lateral axes, whose stiffness gives
    the force; `force` is None for z, where refused, and where the tether's extension is not known;
    `force_sample_pN` are the draws behind it. Where `shares_force`, x and y have one force between
    them. `force_alone` is the force that this trace tells by itself, given the friction expected.
    `free` is the fit without prior knowledge of the friction; the effective radius is read from it,
    on the lateral axes (z mixes in the lateral motion: its friction is no measure of the radius).
    """

    axis: str
    method: str
    free: TraceFit | None = None
    fit: TraceFit | None = None
    posterior: Posterior | None = None
    force: Estimate | None = None
    force_alone: Estimate | None = None
    effective_radius: Estimate | None = None
    force_sample_pN: FloatArray | None = None
    shares_force: bool = False
    refusal: str = ""

    def __repr__(self) -> str:
        if self.estimates is None:
            return f"{self.axis}: refused, {self.refusal}"
        force = "" if self.force is None else f"force {self.force}, "
        return f"{self.axis}: {force}stiffness {self.estimates.stiffness}"

    @property
    def estimates(self) -> Posterior | TraceFit | None:
        """Where to read stiffness, friction, noise and corner frequency; None where refused."""
        return None if self.refusal else self.posterior or self.fit

    @property
    def status(self) -> Status:
        """The word of this trace by itself: its stiffness's, or its force's where that is worse."""
        known = self.estimates
        if known is None:
            return "refused"
        if known.stiffness.status != "ok" or self.force is None:
            return known.stiffness.status
        return self.force.status


@dataclass(frozen=True, repr=False)
class PlateauResult:
    """Calibration of one bead in one plateau; extension and its standard error in nm.

    `not_one_state` says why the plateau gives no force to use: it mixes several states. Empty for
    a sound one.

    `stage_stderr_nm` is the part of that error which is the stage's motion since z = 0; 0 where
    reference beads took it off.
    """

    trace: Trace
    extension_nm: float
    extension_stderr_nm: float
    axes: tuple[AxisResult, ...]
    not_one_state: str = ""
    stage_stderr_nm: float = 0.0

    def __repr__(self) -> str:
        extension = with_error(self.extension_nm, self.extension_stderr_nm, brief=False)
        axes = "; ".join(map(repr, self.axes))
        return f"PlateauResult {self.plateau.number}: extension {extension} nm; {axes}"

    @property
    def plateau(self) -> Plateau:
        """Where the magnets rested."""
        return self.trace.plateau

    @property
    def own_stderr_nm(self) -> float:
        """Standard error of the extension without the stage's motion."""
        return math.sqrt(max(self.extension_stderr_nm**2 - self.stage_stderr_nm**2, 0.0))

    def status(self, axis: AxisResult) -> Status:
        """The word of one of the plateau's traces; "ok" is a number to use."""
        if self.not_one_state and not axis.refusal:
            return "not_one_state"
        return axis.status

    @property
    def force_status(self) -> Status:
        """The word of the plateau's force by x and y.

        That of the best trace that has a force of its own; a force that x and y share rests on
        both, and is as good as the worse of them. Without any force, that of the stiffnesses.
        """
        lateral = [one for one in self.axes if one.axis != "z"]
        with_force = [one for one in lateral if one.force is not None]
        words = [self.status(one) for one in with_force or lateral]
        shared = any(one.shares_force for one in with_force)
        unusable = [word for word in words if word != "ok"]
        if unusable and (shared or len(unusable) == len(words)):
            return unusable[0]
        return "ok" if words else "refused"


@dataclass(frozen=True, repr=False)
class BeadResult:
    """Calibration of one bead.

    `z_zero_stderr_nm` is the standard error, common to all plateaus, of where z = 0 lies; the
    forces' errors hold it, the extensions' do not. `friction_ratio` is the measured friction over
    the one expected from the setup (wall included if the setup lists it), None where no free fit
    tells it. `radius` is what the series says of the bead's radius, None where it was not fitted.
    `series` says which joint fit the forces come from, "" for none; `left_out` the traces
    (plateau number, axis) that contradict it and were fitted by themselves. `stage_nm2` is the
    (plateaus, plateaus) covariance of the extensions by the stage's motion, None where reference
    beads took it off.
    """

    bead: str
    plateaus: tuple[PlateauResult, ...]
    z_zero_stderr_nm: float
    friction_ratio: Estimate | None
    friction_contradicts: bool
    radius: Estimate | None = None
    series: str = ""
    left_out: tuple[tuple[int, str], ...] = ()
    stage_nm2: FloatArray | None = None

    def __repr__(self) -> str:
        usable = sum(one.force_status == "ok" for one in self.plateaus)
        how = self.series or "each trace by itself"
        return f"BeadResult {self.bead}: {usable} of {len(self.plateaus)} forces to use; {how}"
