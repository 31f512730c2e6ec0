"""The methods of calibration that a plan is judged for, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from mtpipe.design.force_error import NO_FORCE, ForceError
from mtpipe.design.likelihood import error_by_itself, error_in_series
from mtpipe.design.plan import OVERSTRETCHING_PN, Plan
from mtpipe.design.schemes import (
    CORRECTED,
    UNCORRECTED,
    error_of_arctangent,
    error_of_equipartition,
)

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
        Method("equipartition", "equipartition, blur corrected", error_of_equipartition),
        Method(
            "arctangent",
            "arctangent, n = ±1 (2010)",
            partial(error_of_arctangent, correction=CORRECTED),
        ),
        Method(
            "arctangent-uncorrected",
            "arctangent, uncorrected",
            partial(error_of_arctangent, correction=UNCORRECTED),
        ),
    )
}
