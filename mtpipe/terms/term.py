"""What terms have in common: one axis, and a law in the force."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from mtpipe.effects.effect import Evidence, plain
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Parameter
from mtpipe.experiment.step import StepOfAxis
from mtpipe.ground.types import FloatArray

Kind = TypeVar("Kind", bound=StepOfAxis)
Axis = int | tuple[int, int]
# Of laws in the force: what the physics of a tether has lies between, squares of lengths as F^-3.
STEEPEST = 4.0
AXES = "xyz"


def typical_force_pN(evidence: Evidence) -> float:
    """The force at which a term's size is given: the middle of a bead's plateaus, so that size and
    law are determined apart from each other.
    """
    return float(np.exp(np.mean(np.log(evidence.force_pN))))


def relative(force_pN: FloatArray | float, at_pN: float, exponent: float) -> FloatArray:
    """(F/F₀)^p, within what a number can be."""
    ln = exponent * np.log(np.maximum(force_pN, 1e-6) / at_pN)
    return np.asarray(np.exp(np.clip(ln, -50.0, 50.0)))


def law(kind: type[Kind], axis: Axis, field: str = "exponent", what: str = "law") -> Parameter:
    """The power of the force that a term goes with."""
    name = f"{what} of {kind.form} along {axis_name(axis)}"
    return plain(name, "", 0.0, (-STEEPEST, STEEPEST), 1e-3, set_to(kind, axis, field))


def axis_name(axis: Axis) -> str:
    """x, y or z; of a pair, the one whose motion is in which other."""
    return AXES[axis] if isinstance(axis, int) else f"{AXES[axis[1]]} in {AXES[axis[0]]}"


def set_to(kind: type[Kind], axis: Axis, field: str) -> Callable[[Experiment, float], Experiment]:
    """The change of a field of the experiment's step of this kind and axis."""
    return partial(_changed, kind, axis, field)


def of_square(
    kind: type[Kind], axis: Axis, field: str
) -> Callable[[Experiment, float], Experiment]:
    """As `set_to`, of a size whose square is given."""
    return partial(_changed_square, kind, axis, field)


def _changed(
    kind: type[Kind], axis: Axis, field: str, experiment: Experiment, value: float
) -> Experiment:
    step = step_of(experiment, kind, axis)
    assert step is not None
    return with_step(experiment, replace(step, **{field: value}))  # type: ignore[type-var]


def _changed_square(
    kind: type[Kind], axis: Axis, field: str, experiment: Experiment, square: float
) -> Experiment:
    return _changed(kind, axis, field, experiment, math.sqrt(max(square, 0.0)))


def grows(exponent: float) -> str:
    """How something goes with the force, in words."""
    if abs(exponent) < 0.05:
        return "the same at all forces"
    return f"{'growing' if exponent > 0 else 'falling'} as F^{exponent:.1f}".replace("-", "−")
