"""Power of one axis that is the same at all frequencies, with a law in the force."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, variance
from mtpipe.effects.terms.term import (
    AXES,
    grows,
    law,
    of_axis,
    of_square,
    relative,
    typical_force_pN,
)
from mtpipe.experiment.changed import changed
from mtpipe.experiment.changes import with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import Place, Seen
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.physics.normal_numbers import standard_normal

START_NM, LARGEST_NM = 2.0, 300.0


@dataclass(frozen=True)
class WhitePower:
    """Along an axis the record scatters by `size_nm` (F/F₀)^(exponent/2) from frame to frame."""

    place: ClassVar[Place] = "tracker"
    form: ClassVar[str] = "white"
    axis: int
    at_pN: float
    size_nm: float
    exponent: float = 0.0

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """More of what is independent from frame to frame."""
        white = seen.white_nm2.copy()
        white[self.axis, self.axis] += self.size_nm**2 * float(
            relative(force_pN, self.at_pN, self.exponent)
        )
        return changed(seen, white_nm2=white)

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """Independent normal numbers."""
        scattered = position_nm.copy()
        size = self.size_nm * relative(force_pN, self.at_pN, self.exponent / 2)
        scattered[:, self.axis] += size * standard_normal(random, (len(force_pN),))
        return scattered

    @property
    def words(self) -> str:
        """Scatter, and how its square goes with the force."""
        return (
            f"{AXES[self.axis]} scatters by {self.size_nm:.2g} nm from frame to frame at "
            f"{self.at_pN:.2g} pN, its square {grows(self.exponent)}"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Scatter at F₀, and its law."""
        return [("size_nm", self.size_nm, "nm"), ("exponent", self.exponent, "")]


def along(axis: int) -> Effect:
    """The term of one axis."""
    return of_axis(f"white_{AXES[axis]}", WhitePower, axis, partial(_begun, axis))


def _begun(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    start = WhitePower(axis, typical_force_pN(evidence), START_NM)
    size = of_square(WhitePower, axis, "size_nm")
    name = f"white power along {AXES[axis]}"
    return [
        Hypothesis(
            with_step(experiment, start),
            (variance(name, "nm", START_NM, LARGEST_NM, size), law(WhitePower, axis)),
        )
    ]
