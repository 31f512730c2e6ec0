"""Recorded height that contains a share of x and y (PHYSICS E24).

A look-up table's image that leans, or is not round, moves with the bead: z follows the camera's
x and y at once, at every frequency alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changed import changed
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import Place, Seen
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import with_minus
from mtpipe.physics.camera import Camera

# Largest share of x or y in z. Real recordings have 0.02 to 0.35; with more, z is hardly a height.
LARGEST = 0.8


@dataclass(frozen=True)
class Crosstalk:
    """z as recorded is z + x times `from_x` + y times `from_y`."""

    place: ClassVar[Place] = "optics"
    from_x: float = 0.0
    from_y: float = 0.0

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) positions behind over positions before."""
        return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [self.from_x, self.from_y, 1.0]])

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """Power of z, and what it has in common with x and y."""
        return seen.through(self.matrix)

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """z that follows x and y."""
        return position_nm @ self.matrix.T


def _of(experiment: Experiment) -> Crosstalk:
    return step_of(experiment, Crosstalk) or Crosstalk()


def _from_x(experiment: Experiment, share: float) -> Experiment:
    return with_step(experiment, changed(_of(experiment), from_x=share))


def _from_y(experiment: Experiment, share: float) -> Experiment:
    return with_step(experiment, changed(_of(experiment), from_y=share))


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    shares = (
        plain("share of x in z", "", 0.0, (-LARGEST, LARGEST), 1e-3, _from_x),
        plain("share of y in z", "", 0.0, (-LARGEST, LARGEST), 1e-3, _from_y),
    )
    return [Hypothesis(experiment, shares)]


def _cause(experiment: Experiment) -> str:
    share = _of(experiment)
    return (
        "the recorded height follows x and y: it contains "
        f"{with_minus(f'{share.from_x:+.3f} times x and {share.from_y:+.3f} times y')}"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    share = _of(experiment)
    return [("slope_x", share.from_x, ""), ("slope_y", share.from_y, "")]


_REMEDY = "check the focus and the illumination: the image is tilted or lopsided."
EFFECT = Effect(
    "z_crosstalk",
    _hypotheses,
    _cause,
    _strengths,
    remedy=_REMEDY,
    unnamed=("mixing", ("z", "x", "y")),
)
