"""A bead or a tether that changes while the recording lasts: another friction, another length.

Something grows on the bead, a protein folds up the tether, the buffer warms. It changes with one of
the plateaus, or evenly all through the recording.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.effects.terms.term import of_axis, set_to
from mtpipe.experiment.changes import scaled_contour_length, scaled_viscosity, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import NothingByItself, Place

# Largest ln of the change over a recording: 7.4 times the friction, 1.6 times the length.
LARGEST_LN_FRICTION, LARGEST_LN_LENGTH = 2.0, 0.5


@dataclass(frozen=True)
class _Course(NothingByItself):
    """A factor on something of the experiment, from 1 to e^ln_change.

    Plateaus are counted from 0, and last a half before and after their number. `first`, `last` :
    where the change begins and ends; even between.
    """

    place: ClassVar[Place] = "tether"
    form: ClassVar[str] = "course"
    what: ClassVar[str] = ""
    axis: ClassVar[None] = None
    first: float
    last: float
    ln_change: float = 0.0

    def ln_factor(self, plateau: int) -> float:
        """In one plateau."""
        passed = (plateau - self.first) / (self.last - self.first)
        return math.log1p(math.expm1(self.ln_change) * min(max(passed, 0.0), 1.0))

    @property
    def words(self) -> str:
        """The factor, and when."""
        factor = f"{self.what} becomes {math.exp(self.ln_change):.3f} times what it was"
        if self.is_step:
            return f"{factor} with plateau {self.last + 1:.0f} of those fitted"
        return f"{factor}, evenly from the beginning to the end"

    @property
    def is_step(self) -> bool:
        """Whether it changes at once, between two plateaus."""
        return self.last == self.first + 1

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Factor, and of a step the index of the plateau with which it comes."""
        factor = ("factor", math.exp(self.ln_change), "")
        return [factor, ("first_plateau", self.last, "")] if self.is_step else [factor]


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
    kind: Callable[[float, float], FrictionCourse | LengthCourse],
    name: str,
    largest: float,
    experiment: Experiment,
    evidence: Evidence,
) -> list[Hypothesis]:
    """A step to each plateau, and a change all along."""
    plateaus = len(evidence.force_pN)
    begun = [kind(k - 1, k) for k in range(1, plateaus)]
    if plateaus > 2:
        begun.append(kind(-0.5, plateaus - 0.5))
    found = []
    for one in begun:
        change = set_to(type(one), None, "ln_change")
        size = plain(name, "", 0.0, (-largest, largest), 1e-3, change)
        found.append(Hypothesis(with_step(experiment, one), (size,), chosen_from=len(begun)))
    return found


def of_friction() -> Effect:
    """Friction that changes."""
    begun = partial(_begun, FrictionCourse, "ln of friction's change", LARGEST_LN_FRICTION)
    return of_axis("course_of_friction", FrictionCourse, None, begun)


def of_length() -> Effect:
    """A length that changes."""
    begun = partial(_begun, LengthCourse, "ln of length's change", LARGEST_LN_LENGTH)
    return of_axis("course_of_length", LengthCourse, None, begun)
