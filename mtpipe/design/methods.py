"""The methods of calibration that a plan is judged for, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from mtpipe.design.force_error import NO_FORCE, ForceError
from mtpipe.design.likelihood import error_by_itself, error_in_series
from mtpipe.design.plan import OVERSTRETCHING_PN, Plan
from mtpipe.design.schemes import error_of_arctangent, error_of_equipartition
from mtpipe.methods.by_name import FIELD_METHODS
from mtpipe.methods.integrated_spectrum import CORRECTED, UNCORRECTED

BOTH = "both"
ALONG, ACROSS = "along", "across"


@dataclass(frozen=True)
class Method:
    """A method: its words, and the error it makes of a plan's force on an axis (0, 1)."""

    name: str
    words: str
    error_on: Callable[[Plan, float, int], ForceError]
    axes: tuple[str, ...] = (ALONG, ACROSS)

    def error(self, plan: Plan, force_pN: float, axis: str) -> ForceError:
        """Error at a force; none can be had where the tether does not hold the bead, or tears.

        Parameters
        ----------
        axis : "along" the field, "across" it, or "both", one of `axes`.
        """
        if force_pN > OVERSTRETCHING_PN or plan.touches(force_pN):
            return NO_FORCE
        along = plan.experiment.along
        return self.error_on(plan, force_pN, 1 - along if axis == ACROSS else along)


def _of_field(name: str, error_on: Callable[[Plan, float, int], ForceError]) -> Method:
    """A method of the field, whose force errors have a closed form that needs no recording."""
    return Method(name, FIELD_METHODS[name].words, error_on)


METHODS = {
    method.name: method
    for method in (
        Method(
            "series",
            "joint fit of a series",
            lambda plan, force, _: error_in_series(plan, force),
            axes=(BOTH,),
        ),
        Method(
            "friction known",
            "exact likelihood, friction known",
            partial(error_by_itself, friction_known=True),
        ),
        Method(
            "friction free",
            "exact likelihood, friction free",
            partial(error_by_itself, friction_known=False),
        ),
        _of_field("equipartition", error_of_equipartition),
        _of_field("arctangent", partial(error_of_arctangent, correction=CORRECTED)),
        _of_field("arctangent-uncorrected", partial(error_of_arctangent, correction=UNCORRECTED)),
    )
}
