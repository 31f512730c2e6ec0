"""An axis that wanders, or is recorded too large, in each plateau by as much as it does there.

A height is read from a look-up table, whose error has another slope at each height and changes with
the focus, and from the difference to references, each with a wander of its own. Neither goes with
the force, nor lasts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain, variance
from mtpipe.effects.terms.mixing import LARGEST, Gain
from mtpipe.effects.terms.power_law import LARGEST_NM, START_NM, START_SLOPE, PowerLaw, times_of
from mtpipe.effects.terms.step import STEEPNESS
from mtpipe.effects.terms.term import AXES, of_axis, set_to
from mtpipe.effects.z_response import BENT_SLOPE, SLOPE
from mtpipe.experiment.changed import changed
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import NothingByItself, Place


@dataclass(frozen=True)
class _ByPlateau(NothingByItself):
    """Something of an axis that has a value of its own in each plateau, `each` (plateaus,)."""

    place: ClassVar[Place]
    form: ClassVar[str] = "course"
    axis: int
    each: tuple[float, ...]


@dataclass(frozen=True)
class WanderByPlateau(_ByPlateau):
    """Power along an axis that goes as f^−slope, in each plateau of a size of its own.

    `each` : sizes in nm, as of `PowerLaw`, with its `times_s`.
    """

    place: ClassVar[Place] = "tether"
    times_s: tuple[float, ...] = ()
    slope: float = START_SLOPE

    def in_plateau(self, plateau: int) -> PowerLaw:
        """What it is in one plateau."""
        return PowerLaw(self.axis, 1.0, self.each[plateau], self.times_s, self.slope)

    @property
    def words(self) -> str:
        """The sizes, and the power of the frequency."""
        sizes = ", ".join(f"{size:.2g}" for size in self.each)
        return (
            f"{AXES[self.axis]} wanders otherwise in each plateau: by {sizes} nm around 1 Hz in "
            f"those fitted, its power going as f^−{self.slope:.1f}"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Size in each plateau, counted from 0, and power of the frequency."""
        sizes = [(f"size_nm_{k}", size, "nm") for k, size in enumerate(self.each)]
        return [*sizes, ("slope", self.slope, "")]


@dataclass(frozen=True)
class GainByPlateau(_ByPlateau):
    """Motion along an axis is recorded too large, in each plateau by a factor of its own.

    `each` : ln of the factors.
    """

    place: ClassVar[Place] = "optics"

    def in_plateau(self, plateau: int) -> Gain:
        """What it is in one plateau."""
        return Gain(self.axis, 1.0, self.each[plateau])

    @property
    def words(self) -> str:
        """The factors."""
        factors = ", ".join(f"{math.exp(one):.3f}" for one in self.each)
        return (
            f"motion along {AXES[self.axis]} is recorded too large by another factor in each "
            f"plateau: {factors} in those fitted"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Factor in each plateau, counted from 0."""
        return [(f"factor_{k}", math.exp(one), "") for k, one in enumerate(self.each)]


def wander_along(axis: int) -> Effect:
    """Another wander of one axis in each plateau."""
    name = f"wander_by_plateau_{AXES[axis]}"
    return of_axis(name, WanderByPlateau, axis, partial(_wanders, axis))


def gain_along(axis: int) -> Effect:
    """Another gain of one axis in each plateau."""
    return of_axis(f"gain_by_plateau_{AXES[axis]}", GainByPlateau, axis, partial(_gains, axis))


def _wanders(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    """One; none where a plateau is alone, as `PowerLaw` says the same."""
    plateaus = len(evidence.force_pN)
    if plateaus < 2:
        return []
    name = f"wandering along {AXES[axis]}"
    begun = WanderByPlateau(axis, (START_NM,) * plateaus, times_of(experiment))
    sizes = [
        variance(_in(name, k), "nm", START_NM, LARGEST_NM, partial(_of_square, axis, k))
        for k in range(plateaus)
    ]
    change = set_to(WanderByPlateau, axis, "slope")
    slope = plain(f"slope of {name}", "", START_SLOPE, STEEPNESS, 1e-3, change)
    return [Hypothesis(with_step(experiment, begun), (*sizes, slope))]


def _gains(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    """One, with the prior of a table's slope; none where a plateau is alone, as for `Gain`."""
    plateaus = len(evidence.force_pN)
    if plateaus < 2:
        return []
    name = f"ln of the gain along {AXES[axis]}"
    each = [
        plain(_in(name, k), "", 0.0, (-LARGEST, LARGEST), 1e-3, partial(_with_gain, axis, k))
        for k in range(plateaus)
    ]
    return [
        Hypothesis(
            with_step(experiment, GainByPlateau(axis, (0.0,) * plateaus)),
            tuple(replace(one, prior=(0.0, SLOPE)) for one in each),
            given=plateaus,
            # a table is no straight line within a plateau: its slope is not known better than that
            learned_nats=plateaus * math.log(SLOPE / BENT_SLOPE),
        )
    ]


def _in(name: str, plateau: int) -> str:
    return f"{name} in plateau {plateau + 1}"


def _of_square(axis: int, plateau: int, experiment: Experiment, square: float) -> Experiment:
    """With another square of the size of the wander in one plateau."""
    return _with_one(WanderByPlateau, axis, plateau, experiment, math.sqrt(max(square, 0.0)))


def _with_gain(axis: int, plateau: int, experiment: Experiment, ln_gain: float) -> Experiment:
    """With another gain in one plateau."""
    return _with_one(GainByPlateau, axis, plateau, experiment, ln_gain)


def _with_one(
    kind: type[_ByPlateau], axis: int, plateau: int, experiment: Experiment, value: float
) -> Experiment:
    step = step_of(experiment, kind, axis)
    assert step is not None
    each = (*step.each[:plateau], value, *step.each[plateau + 1 :])
    return with_step(experiment, changed(step, each=each))
