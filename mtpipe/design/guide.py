"""The whole answer for one setup: ranges of force, what changes would buy, what reaches a force."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtpipe.design.changes import Reach, Variant, reaches, variants
from mtpipe.design.limits import ForceRange, all_ranges
from mtpipe.design.methods import METHODS
from mtpipe.design.plan import Plan, plan_of
from mtpipe.ground.errors import SetupError
from mtpipe.ground.notice import Notice
from mtpipe.ground.types import FloatArray
from mtpipe.setup.setup import Setup

DEFAULT_FRAMES = 16_384


@dataclass(frozen=True)
class Design:
    """Which forces a planned experiment measures.

    Attributes
    ----------
    error : relative root-mean-square error that is allowed.
    ranges : of every method and axis.
    variants : the ranges after single changes, on each method's first axis.
    reach_pN, reaches : a force that is asked for, and what reaches it; None and empty if none is.
    """

    plan: Plan
    error: float
    ranges: tuple[ForceRange, ...]
    variants: tuple[Variant, ...]
    reach_pN: float | None
    reaches: tuple[Reach, ...]
    notices: tuple[Notice, ...]


def measurable_forces(
    setup: Setup,
    *,
    frames: int | None = None,
    duration_s: float | None = None,
    error: float = 0.1,
    reach_pN: float | None = None,
) -> Design:
    """Which forces the experiment of a setup measures within an error, and what would help.

    Parameters
    ----------
    frames, duration_s : of each plateau, one of the two; neither: 16384 frames.
    error : relative root-mean-square error allowed, bias and scatter together.
    reach_pN : a force for which the cheapest change is sought.

    Raises
    ------
    SetupError : something that is needed is unknown, or an argument cannot be.
    """
    if not 0 < error < 1:
        raise SetupError(f"an error of {error:g} cannot be aimed at", mend="Give 0.1 for 10 %.")
    if reach_pN is not None and not (reach_pN > 0 and math.isfinite(reach_pN)):
        raise SetupError(f"a force of {reach_pN:g} pN cannot be reached", mend="Give it above 0.")
    rate = setup.camera.frame_rate_hz.value
    if duration_s is not None and rate is not None:
        if not (duration_s > 0 and math.isfinite(duration_s)):
            raise SetupError(f"a plateau of {duration_s:g} s cannot be", mend="Give it above 0.")
        frames = round(duration_s * rate)
    plan, notices = plan_of(setup, DEFAULT_FRAMES if frames is None else frames)
    return Design(
        plan,
        error,
        all_ranges(plan, error),
        variants(plan, error),
        reach_pN,
        () if reach_pN is None else reaches(plan, reach_pN, error),
        notices,
    )


def error_curve(
    plan: Plan, method: str, axis: str, forces_pN: FloatArray, *, beyond: float
) -> FloatArray:
    """Root-mean-square error of a method at each force; NaN from where it is far beyond.

    Parameters
    ----------
    forces_pN : (n,) rising.
    beyond : once the error is above this on the way up, larger forces are left out.
    """
    errors = np.full(len(forces_pN), np.nan)
    seen = False
    for i, force in enumerate(forces_pN):
        total = METHODS[method].error(plan, float(force), axis).total
        if not math.isfinite(total):
            continue
        errors[i] = total
        seen |= total < beyond
        if seen and total > beyond:
            break
    return errors
