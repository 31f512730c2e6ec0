"""A described experiment taken apart into what data at one steady force depend on, layer by layer.

Fits change one layer at a time, and ask again and again. Of equal layers there is one object, so
that what is worked out of them is found by that.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

from mtpipe.experiment.changed import changed
from mtpipe.experiment.description import Clock, Experiment, Optics, Stage, Tracker
from mtpipe.experiment.recorded_modes import BeadState
from mtpipe.experiment.state import bead_states
from mtpipe.ground.errors import FitError

# Size of the cache of descriptions, each with its bead states.
MOST_KNOWN = 512


@dataclass(frozen=True, eq=False)
class Core:
    """The part of a description that the bead's motion depends on, and states of the bead that are
    known by force, or why there is none.
    """

    experiment: Experiment
    known: dict[float, BeadState | FitError] = field(default_factory=dict)

    def know(self, forces_pN: Sequence[float]) -> None:
        """Work out the states at forces, all at once."""
        missing = [force for force in forces_pN if force not in self.known]
        if missing:
            self.known.update(zip(missing, bead_states(self.experiment, missing), strict=True))

    def state(self, force_pN: float) -> BeadState:
        """The bead at a force.

        Raises
        ------
        FitError : the force is too small to keep the bead off the surface.
        """
        self.know([force_pN])
        found = self.known[force_pN]
        if isinstance(found, FitError):
            raise found.with_traceback(None)
        return found


@dataclass(frozen=True, eq=False)
class Moving:
    """The part of a description that the recorded motion depends on, noise and lines apart."""

    experiment: Experiment
    core: Core


@dataclass(frozen=True, eq=False)
class Steady:
    """A description at a steady force."""

    experiment: Experiment
    moving: Moving


@functools.lru_cache(maxsize=MOST_KNOWN)
def steady_of(experiment: Experiment) -> Steady:
    """A description without its plateaus and the courses of their forces."""
    if experiment.rests or experiment.magnets.courses:
        magnets = changed(experiment.magnets, courses=())
        return steady_of(changed(experiment, rests=(), magnets=magnets))
    return Steady(experiment, _moving(experiment))


def steady_in_each(experiment: Experiment, plateaus: int) -> list[Steady]:
    """A description as it is in each plateau."""
    if not experiment.varies:
        return [steady_of(experiment)] * plateaus
    return [steady_of(experiment.in_plateau(i)) for i in range(plateaus)]


def _moving(experiment: Experiment) -> Moving:
    left = Stage(unsubtracted_nm_per_root_s=experiment.stage.unsubtracted_nm_per_root_s)
    optics = changed(experiment.optics, z_zero_nm=0.0)
    return _the_moving(changed(experiment, tracker=Tracker(), stage=left, optics=optics))


@functools.lru_cache(maxsize=MOST_KNOWN)
def _the_moving(experiment: Experiment) -> Moving:
    core = changed(experiment, stage=Stage(), optics=Optics(), clock=Clock(), steps=())
    return Moving(experiment, _the_core(core))


@functools.lru_cache(maxsize=MOST_KNOWN)
def _the_core(experiment: Experiment) -> Core:
    return Core(experiment)
