"""A gain of one axis, or a share of one axis in another, with a law in the force.

A gain acts on the motion about the mean: where a plateau lies is a matter of scales.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.effects.terms.term import (
    AXES,
    ByStretches,
    axis_name,
    begun_by_laws,
    grows,
    law,
    of_axis,
    relative,
    set_to,
    typical_force_pN,
)
from mtpipe.experiment.changed import changed
from mtpipe.experiment.changes import with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import Place, Seen
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera

# Largest ln of a gain, and largest share of one axis in another: beyond, an axis is misnamed.
LARGEST = 0.8


@dataclass(frozen=True)
class Gain(ByStretches):
    """Motion along an axis is recorded e^(ln_gain (F/F₀)^exponent) times as large."""

    place: ClassVar[Place] = "optics"
    form: ClassVar[str] = "gain"
    axis: int
    at_pN: float
    ln_gain: float = 0.0
    exponent: float = 0.0

    def factor(self, force_pN: FloatArray | float) -> FloatArray:
        """At a force."""
        return np.asarray(
            np.exp(np.clip(self.ln_gain * relative(force_pN, self.at_pN, self.exponent), -3, 3))
        )

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """Powers and cross-powers of the axis; not the mean height."""
        matrix = np.eye(3)
        matrix[self.axis, self.axis] = float(self.factor(force_pN))
        return changed(seen.through(matrix), height_nm=seen.height_nm)

    def in_stretch(
        self, position_nm: FloatArray, force_pN: float, camera: Camera, random: np.random.Generator
    ) -> FloatArray:
        """About the mean."""
        scaled = position_nm.copy()
        mean = position_nm[:, self.axis].mean()
        scaled[:, self.axis] = mean + self.factor(force_pN) * (position_nm[:, self.axis] - mean)
        return scaled

    @property
    def words(self) -> str:
        """Factor, and how its logarithm goes with the force."""
        factor = float(self.factor(self.at_pN))
        return (
            f"motion along {AXES[self.axis]} is recorded {factor:.3f} times "
            f"as large as it is at {self.at_pN:.2g} pN, its logarithm {grows(self.exponent)}"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Factor at F₀, and the law of its logarithm."""
        return [
            ("factor", float(self.factor(self.at_pN)), ""),
            ("exponent", self.exponent, ""),
        ]


@dataclass(frozen=True)
class Share(ByStretches):
    """Along an axis a share of the motion along another is recorded, share (F/F₀)^exponent."""

    place: ClassVar[Place] = "optics"
    form: ClassVar[str] = "mixing"
    axis: tuple[int, int]
    at_pN: float
    share: float = 0.0
    exponent: float = 0.0

    def at(self, force_pN: FloatArray | float) -> FloatArray:
        """The share at a force."""
        return np.clip(self.share * relative(force_pN, self.at_pN, self.exponent), -3, 3)

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """Powers and cross-powers."""
        matrix = np.eye(3)
        matrix[self.axis] = float(self.at(force_pN))
        return changed(seen.through(matrix), height_nm=seen.height_nm)

    def in_stretch(
        self, position_nm: FloatArray, force_pN: float, camera: Camera, random: np.random.Generator
    ) -> FloatArray:
        """What is along the other axis, about its mean."""
        into, other = self.axis
        mixed = position_nm.copy()
        about = position_nm[:, other] - position_nm[:, other].mean()
        mixed[:, into] += self.at(force_pN) * about
        return mixed

    @property
    def words(self) -> str:
        """Share, and how it goes with the force."""
        into, other = (AXES[i] for i in self.axis)
        return (
            f"{into} contains {self.share:+.3f} of the motion along {other}, {grows(self.exponent)}"
        )

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Share at F₀, and its law."""
        return [("share", self.share, ""), ("exponent", self.exponent, "")]


def gain_along(axis: int) -> Effect:
    """The gain of one axis."""
    return of_axis(f"gain_{AXES[axis]}", Gain, axis, partial(_gain, axis))


def share_in(into: int, other: int) -> Effect:
    """The share of one axis in another."""
    pair = (into, other)
    return of_axis(f"mixing_{AXES[other]}_in_{AXES[into]}", Share, pair, partial(_share, pair))


def _gain(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    start = with_step(experiment, Gain(axis, typical_force_pN(evidence)))
    name, bounds = f"ln of the gain along {AXES[axis]}", (-LARGEST, LARGEST)
    size = plain(name, "", 0.0, bounds, 1e-3, set_to(Gain, axis, "ln_gain"))
    return begun_by_laws(start, size, partial(law, Gain, axis))


def _share(pair: tuple[int, int], experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    start = with_step(experiment, Share(pair, typical_force_pN(evidence)))
    # the effect z_crosstalk has a share of its own
    name, bounds = f"share of {axis_name(pair)} (term)", (-LARGEST, LARGEST)
    size = plain(name, "", 0.0, bounds, 1e-3, set_to(Share, pair, "share"))
    return begun_by_laws(start, size, partial(law, Share, pair))
