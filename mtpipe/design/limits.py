"""The range of force within which a method stays below an error, and what ends it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtpipe.design.force_error import ForceError
from mtpipe.design.methods import ACROSS, METHODS, Method
from mtpipe.design.motion import axis_motion
from mtpipe.design.plan import OVERSTRETCHING_PN, Plan

End = Literal["lower", "upper"]
# Where spectra tell most (PHYSICS section 6), the search begins.
BEST_NYQUIST_RATIO = 0.3
STEP_LN = 0.4
REFINEMENTS = 2
# What stands for the logarithm of an infinite error.
HOPELESS = 50.0


@dataclass(frozen=True)
class Limit:
    """An end of a range: the force in pN, and what does not allow more."""

    force_pN: float
    reason: str


@dataclass(frozen=True)
class ForceRange:
    """Forces that a method measures within the error.

    Attributes
    ----------
    method : of `METHODS`. axis : "along", "across" or "both".
    lower, upper : None where no force is measured within the error.
    best_force_pN, best_error : where the error is smallest, of the forces that were looked at.
    best_reason : what makes up most of it there.
    """

    method: str
    axis: str
    lower: Limit | None
    upper: Limit | None
    best_force_pN: float
    best_error: float
    best_reason: str


def force_range(plan: Plan, method: Method, axis: str, error: float) -> ForceRange:
    """The stretch of forces around the best one with a root-mean-square error within `error`."""
    grid = _grid(plan)
    if not grid:
        never = "the bead is never off the surface"
        return ForceRange(method.name, axis, None, None, math.nan, math.inf, never)
    looked_at: dict[float, ForceError] = {}

    def excess(ln_force: float) -> float:
        if ln_force not in looked_at:
            looked_at[ln_force] = method.error(plan, _force(plan, ln_force), axis)
        total = looked_at[ln_force].total
        return math.log(total / error) if math.isfinite(total) else HOPELESS

    def why(ln_force: float, end: End) -> str:
        cause = looked_at[ln_force].largest
        return _reason(plan, method, axis, _force(plan, ln_force), cause, end)

    start = _best_start(plan, grid)
    if excess(grid[start]) > 0:
        start = min(range(len(grid)), key=lambda i: excess(grid[i]))
    best = grid[start]
    if excess(best) > 0:
        end: End = "upper" if looked_at[best].largest in ("bias", "friction") else "lower"
        return ForceRange(
            method.name,
            axis,
            None,
            None,
            _force(plan, best),
            looked_at[best].total,
            why(best, end),
        )
    limits: dict[End, Limit] = {}
    sides: tuple[tuple[End, list[float], str], ...] = (
        ("lower", grid[start::-1], "the bead touches the surface"),
        ("upper", grid[start:], "DNA overstretches at 65 pN"),
    )
    for end, way, at_edge in sides:
        found = _crossing(excess, way)
        limits[end] = (
            Limit(_force(plan, way[-1]), at_edge)
            if found is None
            else Limit(_force(plan, found[0]), why(found[1], end))
        )
    best = min(looked_at, key=excess)
    return ForceRange(
        method.name,
        axis,
        limits["lower"],
        limits["upper"],
        _force(plan, best),
        looked_at[best].total,
        why(best, "lower"),
    )


def all_ranges(plan: Plan, error: float) -> tuple[ForceRange, ...]:
    """Of every method on each of its axes."""
    return tuple(
        force_range(plan, method, axis, error)
        for method in METHODS.values()
        for axis in method.axes
    )


def _grid(plan: Plan) -> list[float]:
    """ln of the forces that are looked at first, the same for all methods; empty if there is none.

    From the lowest force that holds the bead off the surface to the highest that the tether bears.
    """
    floor, ceiling = math.log(plan.lowest_force_pN), math.log(OVERSTRETCHING_PN)
    if not floor < ceiling:
        return []
    count = math.ceil((ceiling - floor) / STEP_LN) + 1
    return [float(f) for f in np.linspace(floor, ceiling, count)]


def _force(plan: Plan, ln_force: float) -> float:
    """The force, inside its bounds in spite of rounding."""
    return min(max(math.exp(ln_force), plan.lowest_force_pN), OVERSTRETCHING_PN)


def _best_start(plan: Plan, grid: list[float]) -> int:
    ratios = [plan.nyquist_ratio(_force(plan, ln_force)) for ln_force in grid]
    return int(np.argmin([abs(math.log(ratio / BEST_NYQUIST_RATIO)) for ratio in ratios]))


def _crossing(excess: Callable[[float], float], way: list[float]) -> tuple[float, float] | None:
    """Where the error is crossed on the way, and a point just beyond; None where it is not.

    False position, as the logarithm of an error is nearly straight over that of the force; halving
    where beyond there is no result at all.
    """
    beyond = next((i for i, ln_force in enumerate(way) if excess(ln_force) > 0), None)
    if beyond is None:
        return None
    inside, outside = way[beyond - 1], way[beyond]
    for _ in range(REFINEMENTS):
        low, high = excess(inside), excess(outside)
        share = 0.5 if high == HOPELESS else low / (low - high)
        middle = inside + share * (outside - inside)
        if excess(middle) > 0:
            outside = middle
        else:
            inside = middle
    low, high = excess(inside), excess(outside)
    if high == HOPELESS:
        return inside, outside
    return inside + low / (low - high) * (outside - inside), outside


def _reason(plan: Plan, method: Method, axis: str, force_pN: float, cause: str, end: End) -> str:
    """Why there is no less an error at this force."""
    experiment, knowledge = plan.experiment, plan.knowledge
    camera_axis = 1 - experiment.along if axis == ACROSS else experiment.along
    if cause == "bias":
        return _bias(plan, method, axis)
    if cause == "statistics":
        if end == "upper":
            return "blur and aliases leave too little information"
        tau = axis_motion(plan, force_pN, camera_axis).tau_s
        return f"length of the recording: {plan.duration_s / tau:.3g} relaxation times"
    if cause == "friction":
        if method.name == "friction free":
            return "blur and aliases: stiffness and friction cannot be separated"
        return f"friction known to {knowledge.friction:.1%} only"
    known = knowledge.noise_factor
    factor = "" if known is None else f", known within a factor {known:g}"
    return {
        "tilt": "the bead tilts: the mean of z is not the tether's end",
        "noise": f"tracking noise of {experiment.tracker.noise_nm[camera_axis]:g} nm{factor}",
        "exposure": f"exposure known to {knowledge.exposure:.1%} only",
        "lever": "mean extension and radius not known well enough",
        "temperature": f"temperature known to {knowledge.temperature:.1%} only",
    }[cause]


def _bias(plan: Plan, method: Method, axis: str) -> str:
    """What a method leaves out."""
    parts = {
        "equipartition": [],
        "arctangent": ["aliases beyond n = ±1"],
        "arctangent-uncorrected": ["blur and aliases"],
    }[method.name]
    if axis == ACROSS and plan.experiment.bead.turns:
        parts = [*parts, "the bead's rotation"]
    if plan.knowledge.noise_factor is None and any(plan.experiment.tracker.noise_nm[:2]):
        parts = [*parts, "tracking noise, which nothing here measures"]
    return "not corrected: " + ", ".join(parts)
