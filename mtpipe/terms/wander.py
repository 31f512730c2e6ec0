"""An axis that wanders in each plateau by as much as it does there.

A height is read from a look-up table, whose error changes with the focus, and from the difference
to references, each with a wander of its own. Neither goes with the force, nor lasts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain, variance
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import NothingByItself, Place
from mtpipe.terms.power_law import LARGEST_NM, START_NM, START_SLOPE, PowerLaw, times_of
from mtpipe.terms.step import STEEPNESS
from mtpipe.terms.term import AXES, of_axis, set_to


@dataclass(frozen=True)
class WanderByPlateau(NothingByItself):
    """Power along an axis that goes as f^−slope, in each plateau of a size of its own.

    `sizes_nm` : (plateaus,) each as of `PowerLaw`.
    """

    place: ClassVar[Place] = "tether"
    form: ClassVar[str] = "course"
    axis: int
    times_s: tuple[float, ...]
    sizes_nm: tuple[float, ...]
    slope: float = START_SLOPE

    def in_plateau(self, plateau: int) -> PowerLaw:
        """What it is in one plateau."""
        return PowerLaw(self.axis, 1.0, self.sizes_nm[plateau], self.times_s, self.slope)

    @property
    def words(self) -> str:
        """The sizes, and the power of the frequency."""
        sizes = ", ".join(f"{size:.2g}" for size in self.sizes_nm)
        return (
            f"{AXES[self.axis]} wanders otherwise in each plateau: by {sizes} nm around 1 Hz in "
            f"those fitted, its power going as f^−{self.slope:.1f}"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Size in each plateau, counted from 0, and power of the frequency."""
        sizes = [(f"size_nm_{k}", size, "nm") for k, size in enumerate(self.sizes_nm)]
        return [*sizes, ("slope", self.slope, "")]


def along(axis: int) -> Effect:
    """The term of one axis."""
    name = f"wander_by_plateau_{AXES[axis]}"
    return of_axis(name, WanderByPlateau, axis, partial(_begun, axis))


def _begun(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    """One; none where a plateau is alone, as `PowerLaw` says the same."""
    plateaus = len(evidence.force_pN)
    if plateaus < 2:
        return []
    name = f"wandering along {AXES[axis]}"
    begun = WanderByPlateau(axis, times_of(experiment), (START_NM,) * plateaus)
    sizes = [
        variance(f"{name} in plateau {k + 1}", "nm", START_NM, LARGEST_NM, partial(_sized, axis, k))
        for k in range(plateaus)
    ]
    change = set_to(WanderByPlateau, axis, "slope")
    slope = plain(f"slope of {name}", "", START_SLOPE, STEEPNESS, 1e-3, change)
    return [Hypothesis(with_step(experiment, begun), (*sizes, slope))]


def _sized(axis: int, plateau: int, experiment: Experiment, square: float) -> Experiment:
    """With another square of the size in one plateau."""
    step = step_of(experiment, WanderByPlateau, axis)
    assert step is not None
    sizes = list(step.sizes_nm)
    sizes[plateau] = math.sqrt(max(square, 0.0))
    return with_step(experiment, replace(step, sizes_nm=tuple(sizes)))
