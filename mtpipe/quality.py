"""Flags and verdicts: what a user should know before using a force.

A flag is a short code with a sentence, about one trace or one bead. Limits are given with their
reason; where a flag compares numbers, it needs both a size that matters and three standard errors.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from mtpipe.bead_results import AxisResult, BeadResult, PlateauResult
from mtpipe.calibration import Calibration
from mtpipe.conditions import Conditions
from mtpipe.estimate import Estimate
from mtpipe.extension_curve import ForceExtension
from mtpipe.fit.trace import TraceFit
from mtpipe.notice import Notice, Severity
from mtpipe.refusal import STRONGEST_TETHER_PN
from mtpipe.setup import Setup

Verdict = Literal["good", "caution", "refused", "unchecked"]

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
# Look-up tables of two beads agree within a few percent: over this range that is tens of nm.
STAGE_MOVED_NM = 500.0
STAGE_STEP_NM = 100.0
# A few percent of contour length is a usual error of z = 0 and the refractive index; persistence
# length varies with salt and with the calibration of all other lengths.
CONTOUR_DIFFERENCE = 0.05
PERSISTENCE_DIFFERENCE = 0.20
# Tethers of one preparation are alike; one shorter than this share of the others' median is another
# thing: a fragment, or two tethers that hold the bead low.
CONTOUR_RATIO = 0.7
FEWEST_OTHERS = 2
FLAGGED_SHARE = 0.25
P_POOR = 1e-3
LOW_ORDINATES = 6


@dataclass(frozen=True)
class BeadVerdict:
    """Verdict on a bead with its reasons in words.

    `mismatch` is the verdict of the diagnosis, "" without a cross-check. `force_bound_percent` is
    by how much what is unexplained may still move a force of the bead, at most over plateaus
    (68 %); nan without a cross-check. `material` : whether that, or what was named, moves a force
    by more than the tolerance of the setup's `[report]`.
    """

    bead: str
    verdict: Verdict
    reasons: tuple[str, ...]
    mismatch: str = ""
    force_bound_percent: float = math.nan
    material: bool = False


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
            f"The reference beads step by {trace.stage_step_nm:.0f} nm in z since the plateau "
            "before: if the stage did not, every extension from here on is wrong by that.",
        )
    if trace.stage_z_nm > STAGE_MOVED_NM:
        flag(
            "focus_moved",
            "caution",
            f"Stage or focus moved by {trace.stage_z_nm:.0f} nm in z: the extension rests on bead "
            "and reference being scaled alike over that range.",
        )
    for one in plateau.axes:
        if one.refusal:
            severity: Severity = "info" if one.axis == "z" else "warning"
            flag("refused", severity, f"Refused: {one.refusal}.", one.axis)
            continue
        if (plateau.plateau.number, one.axis) in bead.left_out:
            flag(
                "unlike_the_series",
                "caution",
                "This trace contradicts the bead's others and was fitted by itself.",
                one.axis,
            )
        for code, grade, message in _axis_flags(one, calibration.conditions):
            flag(code, grade, message, one.axis)
    for code, grade, message in _extension_flags(plateau, setup):
        flag(code, grade, message)
    difference = _force_difference(plateau)
    if difference is not None:
        flag("fx_fy", "caution", difference)
    known = _known_force(plateau, setup)
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
        if _differs(force, stated.value, stated.stderr, FORCE_DIFFERENCE):
            return (
                f"The setup knows a force of {stated.value:.3g} pN at {at:g} mm; the measured one "
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
        informed = "rests on the friction it was given" if given else "is poorly known"
        flags.append((
            "above_nyquist", "caution" if lateral else "info",
            f"The corner frequency is {ratio:.2g} times the Nyquist frequency: the stiffness "
            f"{informed}.",
        ))  # fmt: skip
    relaxations = fit.spectrum.duration_s * math.exp(fit.theta[0] - fit.theta[1])
    if relaxations < RELAXATION_TIMES:
        flags.append((
            "short_trace", "caution",
            f"The trace lasts only {relaxations:.0f} relaxation times.",
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
    if fit.p_value < P_POOR:
        flags.append((
            "poor_fit", "caution" if lateral else "info",
            f"The spectrum differs from the model's (p = {fit.p_value:.1g}).",
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
        and _differs(radius, stated[0], stated[1], RADIUS_DIFFERENCE)
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
    return f"{names[0].upper()}{names[1:]} cannot be told apart in this trace"


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
    if not _differs(x, y.value, y.stderr, FORCE_DIFFERENCE):
        return None
    return (
        f"The forces from x and y differ: {x.value:.3g} ± {x.stderr:.2g} pN against "
        f"{y.value:.3g} ± {y.stderr:.2g} pN."
    )


def _differs(estimate: Estimate, value: float, stderr: float, size: float) -> bool:
    difference = abs(estimate.value - value)
    return bool(
        difference > size * abs(value) and difference > SIGMAS * math.hypot(estimate.stderr, stderr)
    )


def bead_verdicts(
    calibration: Calibration,
    flags: Mapping[str, tuple[Notice, ...]],
    curves: Mapping[str, ForceExtension],
    setup: Setup,
    shared: tuple[str, ...] = (),
) -> tuple[BeadVerdict, ...]:
    """Verdicts on all beads of a recording, which are also compared with one another.

    Parameters
    ----------
    shared : what spoils every bead, such as a reference bead that moves.
    """
    odd = _unlike_the_others(curves)
    return tuple(
        bead_verdict(
            bead,
            flags[bead.bead],
            curves.get(bead.bead),
            setup,
            (*odd.get(bead.bead, ()), *shared),
        )
        for bead in calibration.beads
    )


def _unlike_the_others(curves: Mapping[str, ForceExtension]) -> dict[str, tuple[str, ...]]:
    """Beads whose tether is far shorter or longer than the others', and what to say of them."""
    lengths = {
        bead: curve.recommended.contour_length_nm
        for bead, curve in curves.items()
        if curve.recommended is not None
    }
    found: dict[str, tuple[str, ...]] = {}
    for bead, own in lengths.items():
        others = [length.value for other, length in lengths.items() if other != bead]
        if len(others) < FEWEST_OTHERS:
            continue
        ratio = own.value / statistics.median(others)
        if abs(math.log(ratio)) > abs(math.log(CONTOUR_RATIO)):
            hint = ", perhaps held by more than one" if ratio < 1 else ""
            found[bead] = (
                f"its tether is {ratio:.2f} times as long as the other beads' (median){hint}",
            )
    return found


def bead_verdict(
    bead: BeadResult,
    flags: tuple[Notice, ...],
    curve: ForceExtension | None,
    setup: Setup,
    compared: tuple[str, ...] = (),
) -> BeadVerdict:
    """Verdict on a bead from the flags of its traces, its friction and its tether.

    "refused": no plateau gives a stiffness. "caution": the bead's friction or tether contradicts
    the setup, or a flag of severity caution or worse stands in more than a quarter of its plateaus.
    Else "good".

    Parameters
    ----------
    compared : what comparing the bead with the others of its recording found.
    """
    lateral = [one for plateau in bead.plateaus for one in plateau.axes if one.axis != "z"]
    usable = [
        one for one in lateral
        if one.estimates is not None and one.estimates.stiffness.status == "ok"
    ]  # fmt: skip
    if not lateral:
        alone = "x and y were not recorded, and the force comes from the lateral motion"
        return BeadVerdict(bead.bead, "refused", (alone,))
    sentences = [one.refusal for one in lateral if one.refusal]
    if not usable:
        fallback = "stiffness is not known in any plateau: not identified, or not converged"
        common = [sentence for sentence, _ in Counter(sentences).most_common(3)]
        return BeadVerdict(bead.bead, "refused", tuple(common) or (fallback,))
    reasons = list(compared)
    if bead.friction_contradicts and bead.friction_ratio is not None:
        ratio = bead.friction_ratio
        wall = "with" if "wall_drag" in setup.model.effects else "without"
        reasons.append(
            f"its friction is {ratio.value:.2f} ± {ratio.stderr:.2f} times that expected from "
            f"radius and viscosity ({wall} the wall's correction)"
        )
    if curve is not None:
        reasons += _tether_reasons(curve, setup)
    plateaus: dict[str, set[int]] = {}
    for notice in flags:
        if notice.severity != "info" and notice.plateau is not None:
            plateaus.setdefault(notice.code, set()).add(notice.plateau)
    for code, where in sorted(plateaus.items(), key=lambda pair: -len(pair[1])):
        if len(where) > FLAGGED_SHARE * len(bead.plateaus):
            reasons.append(f"{FLAG_WORDS[code]} in {len(where)} of {len(bead.plateaus)} plateaus")
    return BeadVerdict(bead.bead, "caution" if reasons else "good", tuple(reasons))


def _tether_reasons(curve: ForceExtension, setup: Setup) -> list[str]:
    """Where the fitted tether contradicts the one configured."""
    fit = curve.recommended
    if fit is None:
        return []
    reasons = []
    stated = (
        ("contour", fit.contour_length_nm, setup.tether.contour_length_nm, CONTOUR_DIFFERENCE),
        (
            "persistence",
            fit.persistence_length_nm,
            setup.tether.persistence_length_nm,
            PERSISTENCE_DIFFERENCE,
        ),
    )
    for name, fitted, configured, size in stated:
        value = configured.value
        if value is None or not _differs(fitted, value, configured.stderr, size):
            continue
        hint = ""
        if name == "persistence" and fitted.value < 0.7 * value:
            hint = "; more than one tether, or a wrong z = 0, does that"
        reasons.append(
            f"its {name} length is {fitted.value:.4g} ± {fitted.stderr:.2g} nm, the setup says "
            f"{value:.4g} nm{hint}"
        )
    return reasons


FLAG_WORDS = {
    "lost_frames": "many frames lost",
    "mistracked": "mistracked frames",
    "refused": "traces refused as no tethered bead's",
    "above_nyquist": "corner frequency near or above Nyquist",
    "short_trace": "traces short against the relaxation time",
    "not_identified": "stiffness not identified",
    "not_converged": "posterior not converged",
    "poor_fit": "spectrum unlike the model",
    "drift": "slow motion left in the trace",
    "effective_radius": "effective radius unlike the setup's",
    "no_extension": "no extension",
    "extension": "extension impossible for the tether",
    "unlike_the_series": "traces that contradict the bead's others",
    "fx_fy": "forces from x and y differ",
    "known_force": "force unlike the one known beforehand",
    "reference_stepped": "reference beads step in z",
    "beyond_dna": "force beyond what double-stranded DNA bears",
    "focus_moved": "stage or focus moved far in z",
}
