"""Flags: what a user should know before using one trace's force.

A flag is a short code with a sentence. Limits are given with their reason; where a flag compares
numbers, it needs both a size that matters and three standard errors. What they make of a bead is
`mtpipe.pipeline.verdict`'s matter.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from mtpipe.calibration.bead_results import AxisResult, BeadResult, PlateauResult
from mtpipe.calibration.calibration import Calibration
from mtpipe.calibration.refusal import STRONGEST_TETHER_PN
from mtpipe.fit.trace import TraceFit
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.notice import Notice, Severity
from mtpipe.ground.status import P_POOR
from mtpipe.ground.written_numbers import number
from mtpipe.setup.conditions import Conditions
from mtpipe.setup.setup import Setup

SIGMAS = 3.0
# te Velthuis et al. 2010: corrected forces hold to 10 % up to 80 % of the Nyquist frequency;
# beyond, the force rests on knowing friction and camera.
NYQUIST_RATIO = 0.8
# 50 relaxation times give the stiffness to 20 % at best: sqrt(2 / 50).
RELAXATION_TIMES = 50.0
RADIUS_DIFFERENCE = 0.10
FORCE_DIFFERENCE = 0.10
# Motors repeat to a few micrometres; [[magnet]] positions are written with two or three decimals.
MAGNET_TOLERANCE_MM = 0.01
LOST_SHARE = 0.05
MISTRACKED_SHARE = 0.01
# Motion of the stage in z (nm) worth a flag: look-up tables of two beads differ by a few percent,
# which is tens of nm over this range.
STAGE_MOVED_NM = 500.0
STAGE_STEP_NM = 100.0
LOW_ORDINATES = 6


def trace_flags(
    calibration: Calibration, bead: BeadResult, plateau: PlateauResult, setup: Setup
) -> tuple[Notice, ...]:
    """Everything to be said about one bead in one plateau, axis by axis and as a whole."""
    found: list[Notice] = []

    def flag(code: str, severity: Severity, message: str, axis: str | None = None) -> None:
        found.append(Notice(code, severity, message, bead.bead, plateau.plateau.number, axis))

    trace = plateau.trace
    frames = len(trace.position_nm)
    if trace.lost > LOST_SHARE * frames:
        flag("lost_frames", "caution", f"{trace.lost} of {frames} frames are lost.")
    if trace.mistracked:
        flag(
            "mistracked",
            "caution" if trace.mistracked > MISTRACKED_SHARE * frames else "info",
            f"{trace.mistracked} frames are mistracked (positions no bead can reach) and were "
            "treated as lost.",
        )
    if trace.stage_step_nm > STAGE_STEP_NM:
        flag(
            "reference_stepped",
            "caution",
            f"The reference beads step by {trace.stage_step_nm:.0f} nm in z after the plateau "
            "before: unless the stage did too, every extension from here on is wrong by as much.",
        )
    if trace.stage_z_nm > STAGE_MOVED_NM:
        flag(
            "focus_moved",
            "caution",
            f"Stage or focus moved by {trace.stage_z_nm:.0f} nm in z: the extension is right "
            "only if z of bead and reference have the same scale over that range.",
        )
    if plateau.not_one_state:
        flag("not_one_state", "caution", f"No force to use: {plateau.not_one_state}.")
    for one in plateau.axes:
        if one.refusal:
            severity: Severity = "info" if one.axis == "z" else "warning"
            flag("refused", severity, f"Refused: {one.refusal}.", one.axis)
            continue
        if (plateau.plateau.number, one.axis) in bead.left_out:
            flag(
                "unlike_the_series",
                "caution",
                "This trace contradicts the bead's other traces and was fitted separately.",
                one.axis,
            )
        for code, grade, message in _axis_flags(one, calibration.conditions):
            flag(code, grade, message, one.axis)
    for code, grade, message in _extension_flags(plateau, setup):
        flag(code, grade, message)
    difference = _force_difference(plateau)
    if difference is not None:
        flag("fx_fy", "caution", difference)
    believed = plateau.plateau.number not in calibration.unbelieved
    known = _known_force(plateau, setup) if believed else None
    if known is not None:
        flag("known_force", "caution", known)
    return tuple(found)


def _known_force(plateau: PlateauResult, setup: Setup) -> str | None:
    """Where the measured force contradicts the one known beforehand for this magnet position."""
    position = plateau.plateau.magnet_mm
    force = next((one.force for one in plateau.axes if one.force is not None), None)
    if position is None or force is None:
        return None
    for magnet in setup.magnet:
        at, stated = magnet.position_mm.value, magnet.force_pN
        if at is None or stated.value is None or abs(at - position) > MAGNET_TOLERANCE_MM:
            continue
        if differs(force, stated.value, stated.stderr, FORCE_DIFFERENCE):
            return (
                f"The setup states a force of {stated.value:.3g} pN at {at:g} mm; the measured one "
                f"is {force.value:.3g} ± {force.stderr:.2g} pN."
            )
    return None


def _axis_flags(one: AxisResult, conditions: Conditions) -> list[tuple[str, Severity, str]]:
    fit, posterior, known = one.fit, one.posterior, one.estimates
    if fit is None or known is None:
        return []
    flags: list[tuple[str, Severity, str]] = []
    lateral = one.axis != "z"
    ratio = fit.nyquist_ratio
    if ratio > NYQUIST_RATIO:
        given = fit.model.friction is not None or one.method.startswith("series")
        informed = "rests on the friction assumed" if given else "is poorly known"
        flags.append((
            "above_nyquist", "caution" if lateral else "info",
            f"The corner frequency is {ratio:.2g} times the Nyquist frequency: the stiffness "
            f"{informed}.",
        ))  # fmt: skip
    if fit.relaxations < RELAXATION_TIMES:
        flags.append((
            "short_trace", "caution",
            f"The trace lasts only {fit.relaxations:.0f} relaxation times.",
        ))  # fmt: skip
    stiffness = known.stiffness
    if stiffness.status == "not_identified":
        low, high = stiffness.interval
        span = (
            f"lies anywhere from {low:.2g} to {high:.2g} pN/nm"
            if math.isfinite(high)
            else "is not bounded by it"
        )
        flags.append((
            "not_identified", "warning" if lateral else "info",
            f"{_together(stiffness.tied_to)}; the stiffness {span}.",
        ))  # fmt: skip
    elif posterior is not None and not posterior.converged:
        flags.append((
            "not_converged", "warning",
            f"The posterior did not converge (R-hat {posterior.r_hat:.3f}, "
            f"{posterior.effective_samples:.0f} independent samples).",
        ))  # fmt: skip
    if one.status == "zero_force":
        flags.append((
            "zero_force", "caution" if lateral else "info",
            "The stiffness, and with it the force, may as well be nought.",
        ))  # fmt: skip
    if fit.p_value < P_POOR:
        flags.append((
            "poor_fit", "caution" if lateral else "info",
            f"The spectrum differs from the model's (p = {number(fit.p_value, 1)}).",
        ))  # fmt: skip
    if one.force is not None and one.force.interval[0] > STRONGEST_TETHER_PN:
        flags.append((
            "beyond_dna", "warning",
            f"{one.force.value:.0f} pN is beyond what double-stranded DNA bears "
            f"({STRONGEST_TETHER_PN:.0f} pN): stuck, or held by more than one tether.",
        ))  # fmt: skip
    excess = _low_frequency_excess(fit)
    if excess is not None:
        flags.append(("drift", "caution" if lateral else "info", excess))
    radius = one.effective_radius
    stated = conditions.radius_nm
    if (
        lateral
        and radius is not None
        and stated is not None
        and differs(radius, stated[0], stated[1], RADIUS_DIFFERENCE)
    ):
        flags.append((
            "effective_radius", "caution",
            f"The friction is that of a bead of {radius.value:.0f} ± {radius.stderr:.0f} nm; the "
            f"setup says {stated[0]:.0f} nm.",
        ))  # fmt: skip
    return flags


def _together(tied_to: tuple[str, ...]) -> str:
    """What a trace does not tell, in words."""
    if len(tied_to) < 2:
        return "This trace does not determine the stiffness"
    names = f"{', '.join(tied_to[:-1])} and {tied_to[-1]}"
    return f"{names[0].upper()}{names[1:]} cannot be separated in this trace"


def _low_frequency_excess(fit: TraceFit) -> str | None:
    """Motion slower than the tether's own, in the lowest ordinates of the spectrum."""
    spectrum = fit.spectrum
    cumulative = np.cumsum(spectrum.ordinates)
    last = int(np.searchsorted(cumulative, LOW_ORDINATES)) + 1
    n = spectrum.ordinates[:last]
    ratio = spectrum.power[:last] / fit.expected_power[:last]
    excess = float(n @ ratio / n.sum())
    if stats.gamma.sf(excess * n.sum(), n.sum()) > P_POOR:
        return None
    return (
        f"Below {spectrum.frequency_hz[last - 1]:.2g} Hz the bead moves {excess:.1f} times as much "
        "(in power) as the tether's own motion: drift is left."
    )


def _extension_flags(plateau: PlateauResult, setup: Setup) -> list[tuple[str, Severity, str]]:
    extension, contour = plateau.extension_nm, setup.tether.contour_length_nm.value
    if not math.isfinite(extension):
        return [
            (
                "no_extension",
                "caution",
                "There is no extension, so no force: z was not recorded, or its zero is unknown.",
            )
        ]
    if extension <= 0:
        return [(
            "extension", "warning",
            f"The mean extension is {extension:.0f} nm: where z = 0 lies is wrong, or the bead "
            "lies on the surface. No force can be given.",
        )]  # fmt: skip
    if contour is not None and extension > 1.1 * contour:
        return [(
            "extension", "warning",
            f"The mean extension of {extension:.0f} nm exceeds the contour length of "
            f"{contour:.0f} nm: the z scale, z = 0 or the contour length is wrong, and the force "
            "with it.",
        )]  # fmt: skip
    return []


def _force_difference(plateau: PlateauResult) -> str | None:
    forces = {one.axis: one.force_alone for one in plateau.axes if one.force_alone is not None}
    if "x" not in forces or "y" not in forces:
        return None
    x, y = forces["x"], forces["y"]
    if not differs(x, y.value, y.stderr, FORCE_DIFFERENCE):
        return None
    return (
        f"The forces from x and y differ: {x.value:.3g} ± {x.stderr:.2g} pN against "
        f"{y.value:.3g} ± {y.stderr:.2g} pN."
    )


def differs(estimate: Estimate, value: float, stderr: float, size: float) -> bool:
    """Whether an estimate is off a value by a share that matters and by three standard errors."""
    difference = abs(estimate.value - value)
    return bool(
        difference > size * abs(value) and difference > SIGMAS * math.hypot(estimate.stderr, stderr)
    )
