"""What an effect is: hypotheses about the experiment, and the sentence that names it.

A hypothesis is a changed description and the parameters that are fitted with it. An effect that the
description already contains has none. Effects of other packages are found by the entry-point group
`mtpipe.effects`, each an `Effect`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

from mtpipe.drift.largest_motion import LargestMotion
from mtpipe.experiment.description import Experiment, ForceCourse
from mtpipe.experiment.parameter import Change, Parameter
from mtpipe.ground.types import FloatArray


@dataclass(frozen=True)
class Evidence:
    """What a first look at the data suggests, for effects that cannot be found by climbing.

    Attributes
    ----------
    lines_hz : frequencies of narrow lines, strongest first.
    force_pN : of the plateaus, as fitted without the effect.
    reference_moves : whether slow motion is the reference's own; None: the data do not tell.
    reference_loose : whether a reference in use moves on its own, as its own trace shows.
    reference_largest : how far the references can move by themselves; None: not looked at.
    focus, heights_nm : of each plateau, how many times the focus was moved before it, and the
        recorded height. Empty: not looked at.
    courses, common_course : of the force in each plateau, and in all of them alike. Empty and a
        change of 0: not looked at, or steady.
    """

    lines_hz: tuple[float, ...]
    force_pN: tuple[float, ...]
    reference_moves: bool | None = None
    reference_loose: bool = False
    reference_largest: LargestMotion | None = None
    courses: tuple[ForceCourse, ...] = ()
    common_course: ForceCourse = field(default_factory=ForceCourse)
    focus: tuple[int, ...] = ()
    heights_nm: tuple[float, ...] = ()


@dataclass(frozen=True)
class Hypothesis:
    """A changed experiment, and the parameters that are fitted with it (added to the others).

    Attributes
    ----------
    read : how many numbers more were read from the data beforehand; they cost like fitted ones.
    chosen_from : how many forms this one was chosen from beforehand; that costs its logarithm.
    given : how many of the parameters have a prior that is no matter of these data; they cost no
        more than that, and `learned_nats`, by how much narrower than it data make them at most.
    own : of an effect that all beads share (`Effect.shared`), a form that each bead may have by
        itself.
    otherwise : another beginning, for where those before it promise nothing.
    """

    experiment: Experiment
    parameters: tuple[Parameter, ...]
    read: int = 0
    chosen_from: int = 1
    given: int = 0
    own: bool = False
    learned_nats: float = 0.0
    otherwise: bool = False

    @property
    def numbers(self) -> int:
        """How many numbers it has; an effect without parameters is a choice still."""
        return max(len(self.parameters) + self.read - self.given, 1)


@dataclass(frozen=True)
class Read:
    """A size that hypotheses are made of, as it was seen.

    Attributes
    ----------
    name : as it is reported and pinned. seen : the evidence with another one.
    fitted : it is a parameter too, and not taken as it was seen.
    """

    name: str
    seen: Callable[[Evidence, float], Evidence]
    fitted: bool = False


@dataclass(frozen=True)
class SingleEvents:
    """How traces show single events.

    Attributes
    ----------
    nats : how much more a bead's heights are like the events than like Gaussian motion, given the
        experiment, the force (pN) of each plateau, the frame interval (s) and the heights (frames,)
        of each (nm, NaN where lost). What it is for either is for simulations to say.
    smooth : the experiment with Gaussian motion of the same power in the place of the events.
    power : says what they do to spectra, of traces that do not show them.
    """

    nats: Callable[[Experiment, Sequence[float], float, Sequence[FloatArray]], float]
    smooth: Callable[[Experiment], Experiment]
    power: Callable[[Experiment], str]


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue.

    Its functions are defined in a module, by name: a lambda cannot be sent to other processes.

    Attributes
    ----------
    name : as FORMATS section 5 has it.
    hypotheses : from the experiment as it is described and the evidence to what may be tried; they
        differ in where their parameters start, or in kind.
    cause : what the changed experiment has, in words that continue "…: ", given the experiment
        with the effect at its fitted strength.
    strengths : name, value and unit of what is reported of such an experiment.
    shared : its size belongs to camera, optics or buffer and is the same for all beads of a
        recording. Its hypotheses then have one parameter, which is 0 where there is no effect.
    still : for an effect that is one only if it moves: from the fitted experiment to what has all
        of it but the motion. Where that fits as well the effect is not named.
    events : for an effect of single events: how many of them the fitted experiment has, given
        force (pN) and duration (s) of each plateau. Of few, spectra are not like their mean.
    single : for an effect of single events: how traces show these, and not only their power.
    read : a size of which its hypotheses are made.
    unnamed : form and axes of a term that says what the effect does; empty where none does. As that
        it is told where something that has no name is likelier in its place.
    form, axes : of a term, which has no name but a form (FORMATS section 4), and the axes that it
        is about; empty for effects.
    remedy : what a user can do about it, in words that continue "…: "; empty for physics that an
        experiment has, which a setup lists.
    """

    name: str
    hypotheses: Callable[[Experiment, Evidence], Sequence[Hypothesis]]
    cause: Callable[[Experiment], str]
    strengths: Callable[[Experiment], Sequence[tuple[str, float, str]]]
    shared: bool = False
    still: Callable[[Experiment], Hypothesis] | None = None
    events: Callable[[Experiment, Sequence[float], Sequence[float]], float] | None = None
    single: SingleEvents | None = None
    remedy: str = ""
    read: Read | None = None
    unnamed: tuple[str, tuple[str, ...]] = ("", ())
    form: str = ""
    axes: tuple[str, ...] = ()


def factor(name: str, change: Change, *, start: float = 0.0, width: float = 1.5) -> Parameter:
    """A factor on what is configured, fitted as its logarithm."""
    return Parameter(name, "", start, -width, width, 1e-3, None, change)


def variance(name: str, unit: str, start: float, largest: float, change: Change) -> Parameter:
    """A size whose square is fitted, at least 0."""
    step = max(0.02 * start**2, 1e-4)
    return Parameter(name, unit, start**2, 0.0, largest**2, step, None, change)


def plain(
    name: str, unit: str, start: float, bounds: tuple[float, float], step: float, change: Change
) -> Parameter:
    """A number fitted as it is."""
    return Parameter(name, unit, start, bounds[0], bounds[1], step, None, change)


def logarithm(
    name: str, unit: str, start: float, bounds: tuple[float, float], change: Change
) -> Parameter:
    """A positive number fitted as its logarithm; `change` takes the number."""
    low, high = (math.log(bound) for bound in bounds)
    of_logarithm = partial(_of_logarithm, change)
    return Parameter(name, unit, math.log(start), low, high, 1e-3, None, of_logarithm)


def _of_logarithm(change: Change, experiment: Experiment, value: float) -> Experiment:
    return change(experiment, math.exp(value))
