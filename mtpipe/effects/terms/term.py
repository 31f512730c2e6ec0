"""What terms have in common: an axis or a pair, a law in the force, words and sizes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Protocol, TypeVar

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changed import changed
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Parameter
from mtpipe.experiment.step import Seen, StepOfAxis
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_mode

AXES = "xyz"
OneOrPair = int | tuple[int, int]
# None: a term that is about all three axes.
Axis = OneOrPair | None
# Largest exponent of the force in a law: those of a tether lie within, squares of lengths as F^-3.
STEEPEST = 4.0
# Laws from which a fit starts where it promises nothing to start from the same at all forces, as
# that is what something else does already: a gain beside a scale. With each its bounds: near 0 the
# two could cancel each other at any size.
OTHER_LAWS = ((-1.0, (-STEEPEST, -0.5)), (1.0, (0.5, STEEPEST)))


class TermStep(StepOfAxis, Protocol):
    """The step of a term, which says what it is."""

    @property
    def words(self) -> str:
        """What the record has, in words that continue "…: "."""

    @property
    def sizes(self) -> list[tuple[str, float, str]]:
        """Name, value and unit of what is reported."""


Kind = TypeVar("Kind", bound=TermStep)


def of_axis(
    name: str,
    kind: type[Kind],
    axis: Axis,
    begun: Callable[[Experiment, Evidence], list[Hypothesis]],
) -> Effect:
    """The term of one axis, of a pair, or of all axes (None).

    Parameters
    ----------
    begun : its hypotheses, of an experiment that has none of it yet.
    """
    return Effect(
        name,
        partial(_hypotheses, kind, axis, begun),
        partial(_words, kind, axis),
        partial(_sizes, kind, axis),
        form=kind.form,
        axes=tuple(AXES[one] for one in _axes(axis)),
    )


def _axes(axis: Axis) -> tuple[int, ...]:
    if axis is None:
        return (0, 1, 2)
    return (axis,) if isinstance(axis, int) else axis


def _hypotheses(
    kind: type[Kind],
    axis: Axis,
    begun: Callable[[Experiment, Evidence], list[Hypothesis]],
    experiment: Experiment,
    evidence: Evidence,
) -> list[Hypothesis]:
    return [] if step_of(experiment, kind, axis) is not None else begun(experiment, evidence)


def _words(kind: type[Kind], axis: Axis, experiment: Experiment) -> str:
    return _step(kind, axis, experiment).words


def _sizes(kind: type[Kind], axis: Axis, experiment: Experiment) -> list[tuple[str, float, str]]:
    return _step(kind, axis, experiment).sizes


def _step(kind: type[Kind], axis: Axis, experiment: Experiment) -> Kind:
    step = step_of(experiment, kind, axis)
    assert step is not None
    return step


def typical_force_pN(evidence: Evidence) -> float:
    """The force at which a term's size is given: the middle of a bead's plateaus, so that size and
    law are determined apart from each other.
    """
    return float(np.exp(np.mean(np.log(evidence.force_pN))))


def relative(force_pN: FloatArray | float, at_pN: float, exponent: float) -> FloatArray:
    """(F/F₀)^p, within what a number can be."""
    ln = exponent * np.log(np.maximum(force_pN, 1e-6) / at_pN)
    return np.asarray(np.exp(np.clip(ln, -50.0, 50.0)))


def _stretches(force_pN: FloatArray) -> Iterator[tuple[slice, float]]:
    """Stretches of one force, each with that force."""
    edges = [0, *(np.flatnonzero(np.diff(force_pN)) + 1).tolist(), len(force_pN)]
    for start, stop in itertools.pairwise(edges):
        yield slice(start, stop), float(force_pN[start])


class ByStretches:
    """What a step does in time, done to each stretch of one force by itself."""

    def in_stretch(
        self, position_nm: FloatArray, force_pN: float, camera: Camera, random: np.random.Generator
    ) -> FloatArray:
        """(frames, 3) positions of a stretch with the step."""
        raise NotImplementedError

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """As `Step.played`."""
        moved = position_nm.copy()
        for rows, force in _stretches(force_pN):
            moved[rows] = self.in_stretch(position_nm[rows], force, camera, random)
        return moved


class Modes(ByStretches):
    """A step that adds motions along one axis, each with a relaxation time of its own."""

    axis: int

    def modes(self, force_pN: float) -> tuple[FloatArray, FloatArray]:
        """(m,) relaxation times and variances at a force."""
        raise NotImplementedError

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """These modes besides."""
        tau_s, variances_nm2 = self.modes(force_pN)
        covariance = np.zeros((len(tau_s), 3, 3))
        covariance[:, self.axis, self.axis] = variances_nm2
        return seen.with_modes(tau_s, covariance)

    def in_stretch(
        self, position_nm: FloatArray, force_pN: float, camera: Camera, random: np.random.Generator
    ) -> FloatArray:
        """Begun anew."""
        moved = position_nm.copy()
        for tau_s, variance_nm2 in zip(*self.modes(force_pN), strict=True):
            moved[:, self.axis] += simulate_mode(variance_nm2, tau_s, camera, len(moved), random)
        return moved


def law(
    kind: type[Kind],
    axis: OneOrPair,
    field: str = "exponent",
    what: str = "law",
    start: float = 0.0,
    bounds: tuple[float, float] = (-STEEPEST, STEEPEST),
) -> Parameter:
    """The power of the force that a term goes with."""
    name = f"{what} of {kind.form} along {axis_name(axis)}"
    return plain(name, "", start, bounds, 1e-3, set_to(kind, axis, field))


def begun_by_laws(
    experiment: Experiment, size: Parameter, law: Callable[..., Parameter]
) -> list[Hypothesis]:
    """A size with a law in the force, begun as the same at all forces; otherwise with other laws.

    Parameters
    ----------
    law : the law's parameter, by its `start` and `bounds`.
    """
    others = [
        Hypothesis(experiment, (size, law(start=start, bounds=bounds)), otherwise=True)
        for start, bounds in OTHER_LAWS
    ]
    return [Hypothesis(experiment, (size, law())), *others]


def axis_name(axis: OneOrPair) -> str:
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
    return with_step(experiment, changed(_step(kind, axis, experiment), **{field: value}))


def _changed_square(
    kind: type[Kind], axis: Axis, field: str, experiment: Experiment, square: float
) -> Experiment:
    return _changed(kind, axis, field, experiment, math.sqrt(max(square, 0.0)))


def grows(exponent: float) -> str:
    """How something goes with the force, in words."""
    if abs(exponent) < 0.05:
        return "the same at all forces"
    return f"{'growing' if exponent > 0 else 'falling'} as F^{exponent:.1f}".replace("-", "−")
