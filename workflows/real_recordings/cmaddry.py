"""cmaddry-run2, the complete case: mtpipe beside its owners, friction, field, tethers.

Every function takes results of mtpipe and returns lines of text; nothing is written to disk.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Collection

import numpy as np
from geometry import attachment_height_nm, circle, stiff_direction_degree
from published import RANGES, ROTATION, THERMAL_ENERGY_PN_NM

from mtpipe.calibration.bead_results import AxisResult, BeadResult, PlateauResult
from mtpipe.calibration.calibration import Calibration, calibrate
from mtpipe.curves.extension_curve import fit_curve
from mtpipe.fit.points import Assay, ExtensionPoints
from mtpipe.ground.estimate import Estimate
from mtpipe.pipeline.results import Run
from mtpipe.recording.recording import Plateau, Recording
from mtpipe.setup.conditions import Conditions
from mtpipe.setup.measured import Measured

GOOD_BEADS = ("b1", "b2", "b4")
# Rows, as plateaus are numbered anew where the beads change. Rests at 21.7 mm: before and after the
# staircase, on whose focus they are, and the long one after 100 turns.
REST, LAST_REST, AFTER_TURNS = 181_000, 264_800, 340_000
STRONG = (REST, LAST_REST, AFTER_TURNS)
STAIRS = range(172_000, 254_000)
# From 21.45 to 14.95 mm, where the force is well above its error.
COMPARED = range(191_700, 228_000)
FEWEST_STAIRS_PN = 0.3


def with_exposure(recording: Recording, exposure_s: float) -> Recording:
    """The recording with an exposure stated in its setup."""
    camera = recording.setup.camera.model_copy(update={"exposure_s": Measured(value=exposure_s)})
    setup = recording.setup.model_copy(update={"camera": camera})
    return dataclasses.replace(recording, setup=setup)


def on_owners_ranges(recording: Recording) -> Calibration:
    """Calibration of the rows that the owners took."""
    plateaus = tuple(Plateau(i, r.start, r.stop, r.magnet_mm) for i, r in enumerate(RANGES))
    return calibrate(dataclasses.replace(recording, plateaus=plateaus))


def table_of_forces(recording: Recording, calibration: Calibration) -> list[str]:
    """mtpipe's forces beside the owners', and the length that makes equipartition theirs."""
    lines = [
        "bead range | owners: Allan spectrum equipartition | mtpipe: F_x (68 %)  F_y (68 %)"
        "  extension nm | length nm that turns var into their equipartition: x  y"
    ]
    results = {bead.bead: bead for bead in calibration.beads}
    for i, rows in enumerate(RANGES):
        for bead in results:
            plateau = results[bead].plateaus[i]
            x, y = (_axis(plateau, name) for name in "xy")
            printed = rows.forces_pN.get(bead)
            lengths = ""
            if printed is not None:
                xyz = recording.positions_nm[bead][rows.start : rows.stop]
                variance = np.nanvar(xyz, axis=0)
                need = printed[2] * variance / THERMAL_ENERGY_PN_NM
                lengths = f"{need[0]:5.0f} {need[1]:5.0f}"
            theirs = " ".join(f"{f:7.4g}" for f in printed) if printed else "-"
            lines.append(
                f"{bead} {rows.name:4} | {theirs:23} | {_interval(x.force_alone)}  "
                f"{_interval(y.force_alone)}  "
                f"{plateau.extension_nm:5.0f} | {lengths}"
            )
    return lines


def joint_fits(calibration: Calibration) -> list[str]:
    """Which joint fit each bead got, its radius, and the traces that were left out of it."""
    lines = ["bead | joint fit | radius nm (68 %) | left out: plateaus of x; of y"]
    for bead in calibration.beads:
        left_out = "; ".join(
            ", ".join(str(number) for number, axis in sorted(bead.left_out) if axis == name) or "-"
            for name in "xy"
        )
        lines.append(
            f"{bead.bead} | {bead.series or 'none'} | {_interval(bead.radius)} | {left_out}"
        )
    return lines


def joint_forces(calibration: Calibration, plateaus: Collection[int]) -> list[str]:
    """Forces of the joint fit in some plateaus beside those of each axis alone."""
    lines = ["bead plateau | F_x, F_y of the joint fit (*: by itself) | each axis alone"]
    for bead in calibration.beads:
        for plateau in bead.plateaus:
            if plateau.plateau.number not in plateaus:
                continue
            axes = [_axis(plateau, name) for name in "xy"]
            joint = ", ".join(
                _with_error(one.force) + ("" if one.method == bead.series else "*") for one in axes
            )
            alone = ", ".join(_with_error(one.force_alone) for one in axes)
            lines.append(f"{bead.bead} {plateau.plateau.number:3} | {joint} | {alone}")
    return lines


def force_ratios(calibration: Calibration) -> list[str]:
    """Whether F_y/F_x, each axis alone, is one number before the turns, and whether that is 1."""
    lines = ["bead | F_y/F_x of the plateaus before the turns | chi2/dof about it | about 1"]
    for bead in calibration.beads:
        logs, errors = [], []
        for plateau in bead.plateaus:
            x, y = (_axis(plateau, name).force_alone for name in "xy")
            if x is None or y is None or plateau.plateau.stop > ROTATION[0]:
                continue
            logs.append(math.log(y.value / x.value))
            errors.append(math.hypot(x.stderr / x.value, y.stderr / y.value))
        if not logs:
            continue
        ratio, weight = np.array(logs), np.array(errors) ** -2.0
        mean, stderr = float(weight @ ratio / weight.sum()), float(weight.sum() ** -0.5)
        lines.append(
            f"{bead.bead} | {math.exp(mean):.2f} ± {math.exp(mean) * stderr:.2f} | "
            f"{weight @ (ratio - mean) ** 2:.0f}/{len(logs) - 1} | "
            f"{weight @ ratio**2:.0f}/{len(logs)}"
        )
    return lines


def friction_table(calibration: Calibration) -> list[str]:
    """Friction over Stokes with the wall, x against y, and the force that friction implies."""
    conditions = calibration.conditions
    lines = [
        f"exposure {conditions.exposure_s * conditions.frame_rate_hz:.2f} of a frame",
        "bead plateau | friction / Stokes x wall: x  y | friction y/x  force y/x |"
        " force / friction ratio: x  y",
    ]
    for bead in calibration.beads:
        for plateau in bead.plateaus:
            if not _holds_any(plateau.plateau, STRONG):
                continue
            x, y = (_axis(plateau, name) for name in "xy")
            ratio = [friction_ratio(one, plateau, conditions) for one in (x, y)]
            force = [one.force_alone.value if one.force_alone else math.nan for one in (x, y)]
            lines.append(
                f"{bead.bead} {plateau.plateau.number:3} | {ratio[0]:5.2f} {ratio[1]:5.2f} | "
                f"{ratio[1] / ratio[0]:5.2f} {force[1] / force[0]:5.2f} | "
                f"{force[0] / ratio[0]:5.2f} {force[1] / ratio[1]:5.2f}"
            )
        over, viscosity = bead.friction_ratio, viscosity_taken(bead, conditions)
        if over is not None:
            stated = over.scaled(viscosity, "")
            lines.append(
                f"{bead.bead} all | {stated.value:.2f} ± {stated.stderr:.2f}; viscosity by the "
                f"other beads {viscosity * conditions.viscosity_mPa_s[0]:.3f} mPa s, over which "
                f"the ratio is {over.value:.2f} ± {over.stderr:.2f}"
            )
    return lines


def friction_ratio(one: AxisResult, plateau: PlateauResult, conditions: Conditions) -> float:
    """Friction of a free fit over Stokes with the wall's factor, as the setup states it."""
    stated = conditions.friction_pN_s_per_nm("xyz".index(one.axis), plateau.extension_nm)
    if one.free is None or stated is None:
        return math.nan
    return one.free.friction.value / stated


def viscosity_taken(bead: BeadResult, conditions: Conditions) -> float:
    """The viscosity that mtpipe took for a bead, from the other beads, over the setup's."""
    assert conditions.radius_nm is not None
    taken = [
        friction_ratio(one, plateau, conditions)
        / (one.effective_radius.value / conditions.radius_nm[0])
        for plateau in bead.plateaus
        for one in plateau.axes
        if one.effective_radius is not None
    ]
    return float(np.median(taken)) if taken else math.nan


def field_axis(calibration: Calibration) -> list[str]:
    """F_x / F_y on the staircase if the field lay along x, and if along y."""
    conditions = calibration.conditions
    radius = conditions.radius_nm
    assert radius is not None
    lines = ["bead | median F_x/F_y above 0.3 pN, field along x | along y"]
    for bead in calibration.beads:
        along_x, along_y = [], []
        for plateau in bead.plateaus:
            x, y = (_axis(plateau, name) for name in "xy")
            strong = x.force_alone is not None and x.force_alone.value > FEWEST_STAIRS_PN
            if plateau.plateau.start not in STAIRS or not strong:
                continue
            if x.force_alone is None or y.force_alone is None:
                continue
            levers = [
                conditions.lever_nm(axis, plateau.extension_nm) or math.nan for axis in (0, 1)
            ]
            stiffness = x.force_alone.value / levers[0] / (y.force_alone.value / levers[1])
            lever = plateau.extension_nm / (plateau.extension_nm + radius[0])
            along_x.append(stiffness * lever)
            along_y.append(stiffness / lever)
        lines.append(f"{bead.bead} | {np.median(along_x):.2f} | {np.median(along_y):.2f}")
    return lines


def attachment(recording: Recording, radius_nm: float) -> list[str]:
    """Where on the bead the tether is, from the circles while the magnets turn."""
    lines = [
        "bead | circle nm | attachment below centre nm | z misses nm | rest | stiff axis, variance "
        "ratio (before the turns) | after"
    ]
    before = next(p for p in recording.plateaus if _holds_any(p, (REST,)))
    turned = next(p for p in recording.plateaus if _holds_any(p, (AFTER_TURNS,)))
    for bead in recording.tethered:
        position = recording.positions_nm[bead]
        ring = circle(position[slice(*ROTATION)])
        height = attachment_height_nm(ring, radius_nm)
        rest = recording.trace_nm(bead, before)
        after = recording.trace_nm(bead, turned)
        stiff, ratio = stiff_direction_degree(rest)
        stiff_after, ratio_after = stiff_direction_degree(after)
        lines.append(
            f"{bead} | {ring.radius_nm:4.0f} | {height:4.0f} | {radius_nm - height:4.0f} | "
            f"{ring.direction_degree(rest):3.0f} deg | {stiff:3.0f} deg {ratio:.2f} | "
            f"{stiff_after:3.0f} deg {ratio_after:.2f}"
        )
    return lines


def tethers(run: Run) -> list[str]:
    """Contour and persistence lengths, and what other readings of the same data make of them."""
    radius = run.calibration.conditions.radius_nm
    assert radius is not None
    lines = ["bead | reading: contour nm, persistence nm, chi2/dof"]
    for bead in run.calibration.beads:
        fit = run.curves[bead.bead].recommended
        if fit is not None:
            lines.append(
                f"{bead.bead} | mtpipe, {fit.model}: {_with_error(fit.contour_length_nm)}, "
                f"{_with_error(fit.persistence_length_nm)}, {fit.chi2:.0f}/{fit.dof}"
            )
        position = run.recording.positions_nm[bead.bead]
        ring = circle(position[slice(*ROTATION)])
        missed = radius[0] - attachment_height_nm(ring, radius[0])
        stairs = [p for p in bead.plateaus if p.plateau.start in STAIRS]
        for name, axis, scale, shift in (
            ("x alone", "x", 1.0, 0.0),
            ("y alone", "y", 1.0, 0.0),
            ("x, attachment off centre", "x", 1.0, missed),
            ("y, attachment off centre", "y", 1.0, missed),
            ("x, that and z x 0.8", "x", 0.8, missed),
            ("y, that and z x 0.8", "y", 0.8, missed),
        ):
            points = _points(stairs, axis, scale, shift, run.calibration.conditions)
            other = fit_curve(bead.bead, points, Assay(run.calibration.conditions.temperature_K))
            if (chosen := other.recommended) is not None:
                lines.append(
                    f"   | {name}: {_with_error(chosen.contour_length_nm)}, "
                    f"{_with_error(chosen.persistence_length_nm)}, {chosen.chi2:.0f}/{chosen.dof}"
                )
    return lines


def curve_table(run: Run) -> list[str]:
    """Extension and force of each bead down the staircase."""
    lines = ["motor mm | " + " | ".join(b.bead + " nm, pN" for b in run.calibration.beads)]
    for i, plateau in enumerate(run.recording.plateaus):
        cells = []
        for bead in run.calibration.beads:
            points = run.curves[bead.bead].points
            cells.append(
                f"{points.extension_nm[i]:5.0f} {points.force_pN[i]:6.3f} ± "
                f"{points.force_stderr_pN[i]:.3f}"
            )
        lines.append(f"{plateau.number:2} {plateau.magnet_mm:6.2f} | " + " | ".join(cells))
    first = run.curves[GOOD_BEADS[0]].points
    for bead in GOOD_BEADS[1:]:
        points = run.curves[bead].points
        errors = np.hypot(
            points.force_stderr_pN / points.force_pN, first.force_stderr_pN / first.force_pN
        )
        told = [i for i, p in enumerate(run.recording.plateaus) if p.start in COMPARED]
        logs, weight = np.log(points.force_pN / first.force_pN)[told], errors[told] ** -2.0
        mean, stderr = weight @ logs / weight.sum(), weight.sum() ** -0.5
        lines.append(
            f"{bead} over {GOOD_BEADS[0]}, {len(told)} plateaus from 21.45 to 14.95 mm: "
            f"{math.exp(mean):.2f} ± {math.exp(mean) * stderr:.2f}"
        )
    return lines


def quality(run: Run) -> list[str]:
    """Verdicts, flags by code, and where the tracker jumped."""
    lines = []
    for verdict in run.verdicts:
        lines.append(f"{verdict.bead}: {verdict.verdict}")
        lines += [f"   {reason}" for reason in verdict.reasons]
        found = Counter(n.code for n in run.flags[verdict.bead] if n.severity != "info")
        lines.append("   flags: " + ", ".join(f"{code} {n}" for code, n in found.most_common()))
    for notice in run.recording.notices:
        if notice.code in ("rotation", "reference_mistracked", "reference_moves", "reference_lost"):
            lines.append(f"{notice.code}: {notice.message}")
    lines += [
        f"{n.bead} plateau {n.plateau}: {n.message}"
        for n in run.notices
        if n.code in ("extension", "mistracked") or (n.code == "off_the_curve")
    ]
    resting = np.zeros(len(run.recording.time_s), dtype=bool)
    for plateau in run.recording.plateaus:
        resting[plateau.start : plateau.stop] = True
    for bead in run.recording.tethered:
        z = run.recording.positions_nm[bead][:, 2]
        jumps = np.abs(np.diff(z)) > 3000.0
        lines.append(
            f"{bead}: z jumps by more than 3 um in {jumps.sum()} frames, "
            f"{(jumps & resting[1:]).sum()} of them in plateaus"
        )
    return lines


def _points(
    plateaus: list[PlateauResult], axis: str, scale: float, shift_nm: float, conditions: Conditions
) -> ExtensionPoints:
    """Points from one axis by itself, with z scaled and shifted by what the attachment hides.

    The force across the field keeps its lever, from the anchor to the bead's centre. Errors hold
    what all plateaus share too.
    """
    assert conditions.radius_nm is not None
    measured = np.array([plateau.extension_nm for plateau in plateaus])
    extension = scale * measured + shift_nm
    lever = extension if axis == "x" else scale * measured + conditions.radius_nm[0]
    alone = [_axis(plateau, axis).force_alone for plateau in plateaus]
    assumed = [conditions.lever_nm("xyz".index(axis), height) or math.nan for height in measured]
    rescaled = lever / np.array(assumed)
    return ExtensionPoints(
        plateau=np.array([plateau.plateau.number for plateau in plateaus], dtype=np.int64),
        force_pN=rescaled * [one.value if one else math.nan for one in alone],
        force_stderr_pN=rescaled * [one.stderr if one else math.nan for one in alone],
        extension_nm=extension,
        extension_stderr_nm=np.array([plateau.extension_stderr_nm for plateau in plateaus]),
        lever_nm=lever,
    )


def _axis(plateau: PlateauResult, name: str) -> AxisResult:
    return next(one for one in plateau.axes if one.axis == name)


def _interval(estimate: Estimate | None) -> str:
    if estimate is None:
        return "-"
    low, high = estimate.interval
    return f"{estimate.value:.4g} ({low:.4g}-{high:.4g})"


def _with_error(estimate: Estimate | None) -> str:
    return "-" if estimate is None else f"{estimate.value:.4g} ± {estimate.stderr:.2g}"


def _holds_any(plateau: Plateau, rows: Collection[int]) -> bool:
    return any(plateau.start <= row < plateau.stop for row in rows)
