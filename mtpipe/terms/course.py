"""A bead or a tether that changes while the recording lasts: another friction, another length.

Something grows on the bead, a protein folds up the tether, the buffer warms. From one plateau to a
later one it changes evenly; between neighbours that is a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import scaled_contour_length, scaled_viscosity, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import Place, Seen
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.terms.term import of_all_axes, set_to

# Largest ln of the change over a recording: 7.4 times the friction, 1.6 times the length.
LARGEST_LN_FRICTION, LARGEST_LN_LENGTH = 2.0, 0.5


@dataclass(frozen=True)
class _Course:
    """A factor on something of the experiment: 1 up to the plateau `first`, e^ln_change from the
    plateau `last` on (indices), even between.
    """

    place: ClassVar[Place] = "tether"
    form: ClassVar[str] = "course"
    what: ClassVar[str] = ""
    axis: ClassVar[None] = None
    first: int
    last: int
    ln_change: float = 0.0

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """It acts on the bead, before anything is seen."""
        return seen

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """It acts on the bead, before anything is seen."""
        return position_nm

    def ln_factor(self, plateau: int) -> float:
        """In one plateau."""
        passed = (plateau - self.first) / (self.last - self.first)
        return self.ln_change * min(max(passed, 0.0), 1.0)

    @property
    def words(self) -> str:
        """The factor, and when."""
        factor = f"{self.what} becomes {math.exp(self.ln_change):.3f} times what it was"
        if self.last == self.first + 1:
            return f"{factor} with plateau {self.last + 1} of those fitted"
        return f"{factor}, evenly from plateau {self.first + 1} to {self.last + 1} of those fitted"

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Factor, and the indices of the plateaus between which it changes."""
        return [
            ("factor", math.exp(self.ln_change), ""),
            ("from_plateau", self.first, ""),
            ("to_plateau", self.last, ""),
        ]


@dataclass(frozen=True)
class FrictionCourse(_Course):
    """The bead's friction changes."""

    what: ClassVar[str] = "friction along all axes"

    def changed_in(self, experiment: Experiment, plateau: int) -> Experiment:
        """The experiment as it is in one plateau."""
        return scaled_viscosity(experiment, self.ln_factor(plateau))


@dataclass(frozen=True)
class LengthCourse(_Course):
    """The tether's length changes."""

    what: ClassVar[str] = "the length of the tether along all axes"

    def changed_in(self, experiment: Experiment, plateau: int) -> Experiment:
        """The experiment as it is in one plateau."""
        return scaled_contour_length(experiment, self.ln_factor(plateau))


def _begun(
    kind: Callable[[int, int], FrictionCourse | LengthCourse],
    name: str,
    largest: float,
    experiment: Experiment,
    evidence: Evidence,
) -> list[Hypothesis]:
    """A step to each plateau, and a change all along."""
    last = len(evidence.force_pN) - 1
    stretches = [(k, k + 1) for k in range(last)]
    if last > 1:
        stretches.append((0, last))
    begun = [kind(*one) for one in stretches]
    found = []
    for one in begun:
        change = set_to(type(one), None, "ln_change")
        size = plain(name, "", 0.0, (-largest, largest), 1e-3, change)
        found.append(Hypothesis(with_step(experiment, one), (size,), chosen_from=len(begun)))
    return found


def of_friction() -> Effect:
    """Friction that changes."""
    begun = partial(_begun, FrictionCourse, "ln of friction's change", LARGEST_LN_FRICTION)
    return of_all_axes("course_of_friction", FrictionCourse, begun)


def of_length() -> Effect:
    """A length that changes."""
    begun = partial(_begun, LengthCourse, "ln of length's change", LARGEST_LN_LENGTH)
    return of_all_axes("course_of_length", LengthCourse, begun)
