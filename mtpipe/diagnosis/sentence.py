"""The sentence about a named effect: what, where, how strong, and what it did to the force."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mtpipe.crosschecking.battery.statistic import Statistic
from mtpipe.crosschecking.check import BeadCheck
from mtpipe.diagnosis.explanation import Explanation, Named
from mtpipe.diagnosis.location import concerned
from mtpipe.diagnosis.size_words import capital, factor, is_large, percent
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import number
from mtpipe.joint_fit.hypotheses import FittedEffect
from mtpipe.recording.recording import AXES

# Forces that change by less are said not to change: less than any calibration of magnetic tweezers
# knows a force to, as radius and viscosity are seldom known to better than a percent.
LEAST_TOLD = 0.01


def sentence(found: Explanation, one: Named) -> str:
    """What, where, how strong, and what leaving it out did to the force."""
    fit = found.fit
    if isinstance(one.found, FittedEffect):
        place = _mended(one)
        where = _where(one.before, place, fit.force_pN) if place is not None else ""
        where = f"This shows most {where}. " if where else ""
        cause = one.found.effect.cause(fit.model.described(fit.theta))
    else:
        where, cause = "", one.found.cause
    # forces and verdict are those of all effects together
    single = len(found.named) == 1
    before, after = number(one.before.p_value, 1), number(one.after.p_value, 2)
    agrees = (
        "agrees with its simulation"
        if found.verdict in ("explained", "described")
        else "is nearer to its simulation, but still differs"
    )
    kind = "term" if one.form else "cause"
    with_it = f"With this {kind} the recording {agrees} (p {before} → {after})"
    without = "Ignoring it"
    if not single:
        with_it = f"With all causes found the recording {agrees}; this one changes p from {before} "
        with_it += f"to {after}"
        without = "Ignoring all causes found"
    also = f" Equally possible: {', '.join(one.equivalent)}." if one.equivalent else ""
    others = f" {one.others}" if one.others else ""
    sure = "" if one.form else f" Probability of this cause: {100 * one.probability:.0f} %."
    consequences = f"{without} {_consequence(found)}. {with_it}."
    return f"{capital(cause)}. {where}{consequences}{sure}{also}{others}"


def _consequence(found: Explanation) -> str:
    """What leaving out all that is named does to the forces."""
    after = found.fit.force_pN
    ln = np.log(found.before.case.fit.force_pN / after)
    return consequence(ln, found.fit.force_stderr_pN / after)


def consequence(ln: FloatArray, stderr: FloatArray) -> str:
    """What changes of forces come to, in words that continue "Ignoring it …".

    A change below 1 %, or within its error, is none.

    Parameters
    ----------
    ln : (plateaus,) ln of the force without over that with the effect.
    stderr : (plateaus,) relative errors of the forces found, which are those of the changes at
        most: what is fitted without the effect uses the same data (Hausman 1978).
    """
    moved = (np.abs(ln) >= LEAST_TOLD) & (np.abs(ln) > stderr)
    if not moved.any():
        size = f"{100 * LEAST_TOLD:g} %" if np.all(np.abs(ln) < LEAST_TOLD) else "its error"
        return f"changed no force by more than {size}"
    parts = [_to_one_side(ln, stderr, moved & side) for side in (ln > 0, ln < 0)]
    return " and ".join(part for part in parts if part)


def _to_one_side(ln: FloatArray, stderr: FloatArray, moved: NDArray[np.bool_]) -> str:
    """The forces that moved up, or those that moved down; empty where none did."""
    if not moved.any():
        return ""
    worst = int(np.argmax(np.where(moved, np.abs(ln), -1.0)))
    many, of = int(moved.sum()), len(ln)
    up = ln[worst] > 0
    forces = "forces" if many == of else f"{many} of {of} forces"
    if is_large(float(ln[worst])):
        size = factor(float(ln[worst]), float(stderr[worst]))
        if up:
            return f"made {forces} up to {size} times as high"
        return f"lowered {forces} to as little as {size} of what they are"
    size = percent(float(ln[worst]), float(stderr[worst]))
    by = f"by up to {size}" if many > 1 else f"by {size}"
    median = abs(100 * math.expm1(float(np.median(ln))))
    middle = f" (median {median:.1f} %)" if many == of > 1 else ""
    return f"{'raised' if up else 'lowered'} {forces} {by}{middle}"


def _mended(one: Named) -> Statistic | None:
    """The statistic whose p rises most with the effect; None where none does."""
    after = dict(zip(one.after.statistics, one.after.p_values, strict=True))
    rises = {
        statistic: math.log(max(float(after[statistic]), 1e-300) / max(float(p), 1e-300))
        for statistic, p in zip(one.before.statistics, one.before.p_values, strict=True)
        if statistic in after
    }
    best = max(rises, key=lambda statistic: rises[statistic], default=None)
    return best if best is not None and rises[best] > 0 else None


def _where(check: BeadCheck, statistic: Statistic, force_pN: FloatArray) -> str:
    """Axes, frequencies and forces that a statistic is about.

    Parameters
    ----------
    force_pN : of the bead's plateaus.
    """
    along = AXES[check.case.fit.model.experiment.along]
    names = {"z": "in height (z)", along: f"along the field ({along})"}
    axes = [names.get(axis, f"across the field ({axis})") for axis in statistic.axis] or [
        "on all axes"
    ]
    parts = [" and ".join(axes)]
    if statistic.band_hz is not None:
        low, high = (f"{hz:.3g}" for hz in statistic.band_hz)
        parts.append(f"{low} Hz" if low == high else f"{low}–{high} Hz")
    plateaus = concerned(check, statistic)
    if len(plateaus) == len(check.case.plateaus):
        parts.append("at all forces")
    else:
        forces = [float(force_pN[k]) for k in plateaus]
        low, high = f"{min(forces):.2g}", f"{max(forces):.2g}"
        numbers = ", ".join(str(check.case.plateaus[k].number) for k in plateaus)
        listed = f"plateau{'s' if len(plateaus) > 1 else ''} {numbers}"
        parts.append(f"at {low if low == high else f'{low}–{high}'} pN ({listed})")
    return ", ".join(parts)
