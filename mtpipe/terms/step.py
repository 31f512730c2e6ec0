"""A tracker that answers otherwise from some plateau on: another gain of an axis, or more scatter.

The image of a bead changes as it turns, or as the focus is moved, and with it what is recorded of
its motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain, variance
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import Place, Seen
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.terms.mixing import LARGEST, Gain
from mtpipe.terms.term import AXES, of_square, set_to
from mtpipe.terms.white import LARGEST_NM, START_NM, WhitePower


@dataclass(frozen=True)
class _FromPlateau:
    """Something that is so from a plateau on (an index), and not before."""

    form: ClassVar[str] = "step"
    axis: int
    first: int

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """Outside plateaus nothing is known of it."""
        return seen

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """Outside plateaus nothing is known of it."""
        return position_nm


@dataclass(frozen=True)
class GainFrom(_FromPlateau):
    """From a plateau on, motion along an axis is recorded e^ln_gain times as large."""

    place: ClassVar[Place] = "optics"
    ln_gain: float = 0.0

    def in_plateau(self, plateau: int) -> Gain:
        """What it is in one plateau."""
        return Gain(self.axis, 1.0, self.ln_gain if plateau >= self.first else 0.0)


@dataclass(frozen=True)
class ScatterFrom(_FromPlateau):
    """From a plateau on, the record scatters along an axis by `size_nm` more."""

    place: ClassVar[Place] = "tracker"
    size_nm: float = 0.0

    def in_plateau(self, plateau: int) -> WhitePower:
        """What it is in one plateau."""
        return WhitePower(self.axis, 1.0, self.size_nm if plateau >= self.first else 0.0)


def gain_along(axis: int) -> Effect:
    """Another gain of one axis."""
    return Effect(
        f"gain_step_{AXES[axis]}",
        partial(_gains, axis),
        partial(_cause_of_gain, axis),
        partial(_strengths_of_gain, axis),
        form=GainFrom.form,
        axes=(AXES[axis],),
    )


def scatter_along(axis: int) -> Effect:
    """More scatter of one axis."""
    return Effect(
        f"scatter_step_{AXES[axis]}",
        partial(_scatters, axis),
        partial(_cause_of_scatter, axis),
        partial(_strengths_of_scatter, axis),
        form=ScatterFrom.form,
        axes=(AXES[axis],),
    )


def _later(evidence: Evidence) -> range:
    return range(1, len(evidence.force_pN))


def _gains(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if step_of(experiment, GainFrom, axis) is not None:
        return []
    name, change = f"ln of the later gain along {AXES[axis]}", set_to(GainFrom, axis, "ln_gain")
    size = plain(name, "", 0.0, (-LARGEST, LARGEST), 1e-3, change)
    return [
        Hypothesis(
            with_step(experiment, GainFrom(axis, k)), (size,), chosen_from=len(_later(evidence))
        )
        for k in _later(evidence)
    ]


def _scatters(axis: int, experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if step_of(experiment, ScatterFrom, axis) is not None:
        return []
    change = of_square(ScatterFrom, axis, "size_nm")
    size = variance(f"later scatter along {AXES[axis]}", "nm", START_NM, LARGEST_NM, change)
    return [
        Hypothesis(
            with_step(experiment, ScatterFrom(axis, k, START_NM)),
            (size,),
            chosen_from=len(_later(evidence)),
        )
        for k in _later(evidence)
    ]


def _cause_of_gain(axis: int, experiment: Experiment) -> str:
    step = step_of(experiment, GainFrom, axis)
    factor, first = (1.0, 0) if step is None else (float(np.exp(step.ln_gain)), step.first)
    return (
        f"motion along {AXES[axis]} is recorded {factor:.3f} times as large from plateau "
        f"{first + 1} of those fitted on"
    )


def _strengths_of_gain(axis: int, experiment: Experiment) -> list[tuple[str, float, str]]:
    step = step_of(experiment, GainFrom, axis)
    if step is None:
        return []
    return [("factor", float(np.exp(step.ln_gain)), ""), ("first_plateau", step.first, "")]


def _cause_of_scatter(axis: int, experiment: Experiment) -> str:
    step = step_of(experiment, ScatterFrom, axis)
    size, first = (0.0, 0) if step is None else (step.size_nm, step.first)
    return (
        f"{AXES[axis]} scatters by {size:.2g} nm more from frame to frame from plateau {first} on"
    )


def _strengths_of_scatter(axis: int, experiment: Experiment) -> list[tuple[str, float, str]]:
    step = step_of(experiment, ScatterFrom, axis)
    if step is None:
        return []
    return [("size_nm", step.size_nm, "nm"), ("first_plateau", step.first, "")]
