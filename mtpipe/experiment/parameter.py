"""A parameter of an experiment: a change of its description that has a size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mtpipe.experiment.description import Experiment

# Functions of a module, or `partial` of one: fits are sent between processes.
Change = Callable[[Experiment, float], Experiment]


@dataclass(frozen=True)
class Parameter:
    """One unknown of the experiment.

    Attributes
    ----------
    name, unit : of the coordinate.
    start, lower, upper : of the coordinate, in its unit.
    step : a change of the coordinate that matters little, for differences.
    prior : mean and standard error of what is known beforehand, or None.
    change : the experiment with the coordinate at a value.
    """

    name: str
    unit: str
    start: float
    lower: float
    upper: float
    step: float
    prior: tuple[float, float] | None
    change: Change
