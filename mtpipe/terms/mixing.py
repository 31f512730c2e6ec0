"""A gain of one axis, or a share of one axis in another, with a law in the force.

A gain acts on the motion about the mean: where a plateau lies is a matter of scales.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import Place, Seen
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.terms.term import AXES, grows, law, relative, set_to, typical_force_pN

# ln of a gain, and a share, beyond which an axis is not what it is called.
LARGEST = 0.8


@dataclass(frozen=True)
class Gain:
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
        return replace(seen.through(matrix), height_nm=seen.height_nm)

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """About the mean of each stretch of one force."""
        scaled = position_nm.copy()
        for force in np.unique(force_pN):
            here = force_pN == force
            mean = position_nm[here, self.axis].mean()
            about = position_nm[here, self.axis] - mean
            scaled[here, self.axis] = mean + self.factor(float(force)) * about
        return scaled


@dataclass(frozen=True)
class Share:
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
        return replace(seen.through(matrix), height_nm=seen.height_nm)

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """What is along the other axis about the mean of each stretch of one force."""
        into, other = self.axis
        mixed = position_nm.copy()
        for force in np.unique(force_pN):
            here = force_pN == force
            about = position_nm[here, other] - position_nm[here, other].mean()
            mixed[here, into] += self.at(float(force)) * about
        return mixed


def gain_along(axis: int) -> Effect:
    """The gain of one axis."""
    return Effect(
        f"gain_{AXES[axis]}",
        partial(_gains, axis),
        partial(_cause_of_gain, axis),
        partial(_strengths_of_gain, axis),
        form=Gain.form,
        axes=(AXES[axis],),
    )


def share_in(into: int, other: int) -> Effect:
    """The share of one axis in another."""
    pair = (into, other)
    return Effect(
        f"mixing_{AXES[other]}_in_{AXES[into]}",
        partial(_shares, pair),
        partial(_cause_of_share, pair),
        partial(_strengths_of_share, pair),
        form=Share.form,
        axes=(AXES[into], AXES[other]),
    )


def _gains(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if step_of(experiment, Gain, axis) is not None:
        return []
    start = with_step(experiment, Gain(axis, typical_force_pN(evidence)))
    name, bounds = f"ln of the gain along {AXES[axis]}", (-LARGEST, LARGEST)
    size = plain(name, "", 0.0, bounds, 1e-3, set_to(Gain, axis, "ln_gain"))
    return [Hypothesis(start, (size, law(Gain, axis)))]


def _shares(pair: tuple[int, int], experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if step_of(experiment, Share, pair) is not None:
        return []
    start = with_step(experiment, Share(pair, typical_force_pN(evidence)))
    into, other = (AXES[i] for i in pair)
    name, bounds = f"share of {other} in {into} (term)", (-LARGEST, LARGEST)
    size = plain(name, "", 0.0, bounds, 1e-3, set_to(Share, pair, "share"))
    law_name = f"law of the share of {other} in {into}"
    bound = (-4.0, 4.0)
    exponent = plain(law_name, "", 0.0, bound, 1e-3, set_to(Share, pair, "exponent"))
    return [Hypothesis(start, (size, exponent))]


def _cause_of_gain(axis: int, experiment: Experiment) -> str:
    step = step_of(experiment, Gain, axis)
    factor = 1.0 if step is None else float(step.factor(step.at_pN))
    at, how = (1.0, "") if step is None else (step.at_pN, f", its logarithm {grows(step.exponent)}")
    return (
        f"motion along {AXES[axis]} is recorded {factor:.3f} times as large as it is at "
        f"{at:.2g} pN{how}"
    )


def _strengths_of_gain(axis: int, experiment: Experiment) -> list[tuple[str, float, str]]:
    step = step_of(experiment, Gain, axis)
    if step is None:
        return []
    return [("factor", float(step.factor(step.at_pN)), ""), ("exponent", step.exponent, "")]


def _cause_of_share(pair: tuple[int, int], experiment: Experiment) -> str:
    step = step_of(experiment, Share, pair)
    into, other = (AXES[i] for i in pair)
    share = 0.0 if step is None else step.share
    how = "" if step is None else f", {grows(step.exponent)}"
    return f"{into} contains {share:+.3f} of the motion along {other}{how}"


def _strengths_of_share(
    pair: tuple[int, int], experiment: Experiment
) -> list[tuple[str, float, str]]:
    step = step_of(experiment, Share, pair)
    if step is None:
        return []
    return [("share", step.share, ""), ("exponent", step.exponent, "")]
