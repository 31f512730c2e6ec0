"""Forces by other methods of the field beside mtpipe's own, for comparison and for those who must.

Each lateral trace by itself, with what the bead's main fit and the setup know: its tracking noise
and the friction expected. None of the methods knows of the bead's rotation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mtpipe.calibration.bead_results import AxisResult, PlateauResult
from mtpipe.calibration.calibration import Calibration
from mtpipe.ground.errors import FitError
from mtpipe.ground.estimate import Estimate, Status
from mtpipe.methods import MethodFit, fit_by_method
from mtpipe.recording.recording import AXES
from mtpipe.setup.conditions import Conditions


@dataclass(frozen=True)
class MethodResult:
    """One trace by one method; `fit` is None where it cannot be applied, `refusal` says why."""

    bead: str
    plateau: PlateauResult
    axis: str
    method: str
    fit: MethodFit | None
    force: Estimate | None
    refusal: str

    @property
    def status(self) -> Status:
        """The word of its force, or of its stiffness; "ok" is a number to use."""
        if self.fit is None:
            return "refused"
        return "not_one_state" if self.plateau.not_one_state else self.fit.stiffness.status


def by_methods(calibration: Calibration, methods: Sequence[str]) -> tuple[MethodResult, ...]:
    """Every lateral trace that was not refused, by each method.

    Raises
    ------
    ValueError : an unknown method.
    """
    return tuple(
        _by_method(bead.bead, plateau, one, method, calibration.conditions)
        for bead in calibration.beads
        for plateau in bead.plateaus
        for one in plateau.axes
        if one.axis != "z" and one.estimates is not None
        for method in methods
    )


def _by_method(
    bead: str, plateau: PlateauResult, one: AxisResult, method: str, conditions: Conditions
) -> MethodResult:
    axis = AXES.index(one.axis)
    known = one.estimates
    noise = known.noise.value if known is not None else math.nan
    friction = conditions.friction_pN_s_per_nm(axis, plateau.extension_nm)
    allowance = conditions.friction_relative_stderr
    try:
        fit = fit_by_method(
            method,
            plateau.trace.position_nm[:, axis],
            frame_rate_hz=conditions.frame_rate_hz,
            exposure_s=conditions.exposure_s,
            temperature_K=conditions.temperature_K,
            tracking_noise_nm=noise if math.isfinite(noise) else "fit",
            friction=None if friction is None else (friction, allowance * friction),
        )
    except FitError as error:
        return MethodResult(bead, plateau, one.axis, method, None, None, str(error))
    lever = conditions.lever_nm(axis, plateau.extension_nm)
    force = None
    if lever is not None:
        error_of_lever = plateau.extension_stderr_nm / lever
        relative = math.hypot(error_of_lever, conditions.temperature_relative_stderr)
        force = fit.stiffness.scaled(lever, "pN").widened(relative)
    return MethodResult(bead, plateau, one.axis, method, fit, force, "")
