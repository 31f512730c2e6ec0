"""A parameter of an experiment: a change of its description that has a size.

Two parameters are one quantity if they change the same of the description (`Parameter.quantity`). A
fit has each quantity once (`already_free`). Here also those that are free in some fits and effects
in others.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import partial

from mtpipe.experiment.changed import changed, with_root
from mtpipe.experiment.description import Experiment, Triple

# The factor on the exposure, and the share of a frame that no exposure is shorter than.
EXPOSURE, SHORTEST_EXPOSURE = "exposure over configured", 0.02
LARGEST_NOISE_NM2 = 1e6

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
    within_error : it is the error of a stated value, beyond which an effect may change the same.
    """

    name: str
    unit: str
    start: float
    lower: float
    upper: float
    step: float
    prior: tuple[float, float] | None
    change: Change
    within_error: bool = False

    @property
    def quantity(self) -> Hashable:
        """What it changes of an experiment: the function of `change`, and what it is bound to."""
        return _quantity(self.change)

    def step_from(self, value: float) -> float:
        """The step, downwards where it would leave the bounds."""
        return self.step if value + self.step <= self.upper else -self.step


def _quantity(change: object) -> Hashable:
    if isinstance(change, partial):
        bound = (*change.args, *sorted(change.keywords.items()))
        return (change.func, *map(_quantity, bound))
    if isinstance(change, tuple):
        return tuple(map(_quantity, change))
    return change if isinstance(change, Hashable) else id(change)


def already_free(parameters: Sequence[Parameter], others: Sequence[Parameter]) -> bool:
    """Whether parameters are free that are the same quantity as one of others.

    Parameters
    ----------
    parameters : of a fit. Errors of stated values among them leave their quantities to effects.
    """
    free = {one.quantity for one in parameters if not one.within_error}
    return any(other.quantity in free for other in others)


def noise_parameters(start_nm: Triple) -> tuple[Parameter, ...]:
    """Variance of the tracking noise along each axis, in nm²."""
    return tuple(
        Parameter(
            f"tracking noise {name}",
            "nm²",
            start_nm[axis] ** 2,
            0.0,
            LARGEST_NOISE_NM2,
            max(0.02 * start_nm[axis] ** 2, 1e-3),
            None,
            partial(_noise, axis),
        )
        for axis, name in enumerate("xyz")
    )


def _noise(axis: int, experiment: Experiment, value: float) -> Experiment:
    noise_nm = with_root(experiment.tracker.noise_nm, axis, value)
    return changed(experiment, tracker=changed(experiment.tracker, noise_nm=noise_nm))
