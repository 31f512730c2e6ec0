"""First pass over a bead: a fit of each trace by itself, and which traces are no tethered bead's.

Stiffness, friction and noise are free; the noise is known within a factor from the reference beads.
What these fits say of the bead's friction is collected for `calibration.friction_prior`.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Mapping

from mtpipe.calibration import refusal
from mtpipe.fit.model import TraceModel
from mtpipe.fit.trace import TraceFit, fit_positions
from mtpipe.ground.errors import FitError
from mtpipe.recording.traces import Trace
from mtpipe.setup.conditions import Conditions

# Free fits that know the friction worse than this say nothing about the bead's friction.
USEFUL_FRICTION_LN = 0.3
LATERAL = (0, 1)
# Beads differ in their rings, and the tether keeps them out of focus: a tethered bead's tracking
# noise is that of the reference beads within this factor (68 %).
NOISE_FACTOR = 2.0


def free_fit(
    trace: Trace,
    axis: int,
    conditions: Conditions,
    extension_nm: float,
    lowest_hz: float,
    noise_nm: float | None,
) -> TraceFit | str:
    """A fit without prior knowledge of the friction, or the reason why there is none."""
    model = functools.partial(
        TraceModel,
        exposure_s=conditions.exposure_s,
        thermal_energy_pN_nm=conditions.thermal_energy_pN_nm,
        noise_variance_nm2=None,
        noise_prior_nm=None if not noise_nm else (noise_nm, NOISE_FACTOR),
        modes=conditions.modes(axis, extension_nm),
    )
    try:
        return fit_positions(
            trace.position_nm[:, axis], 1 / conditions.frame_rate_hz, model, lowest_hz=lowest_hz
        )
    except FitError as error:
        return str(error)


def refusals_of(
    trace: Trace,
    fits: Mapping[int, TraceFit | str],
    conditions: Conditions,
    extension_nm: float,
    contour_length_nm: float,
) -> dict[int, str]:
    """Axes on which the trace is no tethered bead's, and why."""
    lateral = {
        axis: fit for axis, fit in fits.items() if axis in LATERAL and isinstance(fit, TraceFit)
    }
    if len(lateral) == 2:
        relaxation = max(math.exp(fit.theta[1] - fit.theta[0]) for fit in lateral.values())
        circling = refusal.driven(
            trace.position_nm[:, :2], 1 / conditions.frame_rate_hz, relaxation
        )
        if circling is not None:
            return dict.fromkeys(fits, circling)
    tether = max(extension_nm, contour_length_nm) if extension_nm > 0 else contour_length_nm
    still = [refusal.stuck(fit, conditions, axis, tether) for axis, fit in lateral.items()]
    if still and all(still):
        return dict.fromkeys(fits, still[0] or "")
    reasons = {
        axis: fit
        if isinstance(fit, str)
        else refusal.without_plateau(fit, conditions.friction_pN_s_per_nm(axis, extension_nm))
        for axis, fit in fits.items()
    }
    return {axis: reason for axis, reason in reasons.items() if reason is not None}


def whole_bead(refused: list[dict[int, str]], recorded: list[int]) -> list[dict[int, str]]:
    """Refuse all traces of a bead that is no tethered bead in half of its lateral traces or more.

    Chance then decides which of the others look like a tether's.
    """
    lateral = [axis for axis in recorded if axis in LATERAL]
    reasons = [plateau[axis] for plateau in refused for axis in lateral if axis in plateau]
    if not reasons or 2 * len(reasons) < len(refused) * len(lateral):
        return refused
    usual = Counter(reasons).most_common(1)[0][0]
    return [{axis: plateau.get(axis, usual) for axis in recorded} for plateau in refused]


def friction_ratio(
    fit: TraceFit | str, conditions: Conditions, axis: int, extension_nm: float
) -> tuple[float, float] | None:
    """ln of measured over expected friction and its standard error, where the fit knows it."""
    nominal = conditions.friction_pN_s_per_nm(axis, extension_nm)
    if isinstance(fit, str) or nominal is None:
        return None
    stderr = math.sqrt(fit.covariance[1, 1])
    ln_ratio = float(fit.theta[1]) - math.log(nominal)
    # a fit that took drift or noise for the tether's motion says nothing about the bead
    if not stderr < USEFUL_FRICTION_LN or ln_ratio > math.log(refusal.IMPLAUSIBLE_FRICTION):
        return None
    return ln_ratio, stderr
