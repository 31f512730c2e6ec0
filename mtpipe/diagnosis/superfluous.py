"""Effects taken out again that the others make superfluous, or that are not clear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtpipe.crosschecking.check import (
    BeadCheck,
    check_bead,
    comparable_p_values,
)
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.diagnosis.explanation import (
    AGREES_P,
    Named,
)
from mtpipe.diagnosis.heldout import MOST_OF_IT, explained_share
from mtpipe.diagnosis.unexplained import Rejected
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.hypotheses import (
    FittedEffect,
    together,
)

# Net gain (nats, BIC) from which an effect is seen although the battery is silent, and from which
# one is kept at all. With a penalty of 5 nats a gain of 8 is needed, which comes by chance once in
# 16 000 tries of one parameter (χ² above 16); the catalogue tries some 30.
SEEN_NATS, KEPT_NATS = 4.0, 3.0
# What no name describes is imitated the better the more effects are taken for it. A third effect of
# the spectrum has to be unmistakable.
THIRD_NATS = 100.0


def without_superfluous(
    case: PreparedBead, named: list[Named], check: BeadCheck, random: np.random.Generator
) -> tuple[list[Named], BeadCheck]:
    """Drop effects that the others make needless.

    Parameters
    ----------
    case : without any effect of the spectrum. named : in the order found. check : with all of them.

    Returns
    -------
    The effects left and the check with them, each effect's checks before and after brought in line.
    """
    fitted = [one.found for one in named if isinstance(one.found, FittedEffect)]
    for one in fitted if len(fitted) > 1 else []:
        rest = [other for other in fitted if other is not one]
        try:
            fit = together(case.fit, rest, check.case.fit)
        except (FitError, ValueError):
            continue
        if check.case.fit.log_likelihood - fit.log_likelihood - one.penalty < KEPT_NATS:
            again = check_bead(replace(case, fit=fit), random)
            if again.p_value >= min(AGREES_P, check.p_value):
                left = _checked_without(case, named, one, again, random)
                return without_superfluous(case, left, again, random)
    return named, check


def _checked_without(
    case: PreparedBead,
    named: list[Named],
    dropped: FittedEffect,
    after: BeadCheck,
    random: np.random.Generator,
) -> list[Named]:
    """The effects but one, those behind it checked anew; `after` : the check with all of them."""
    at = next(i for i, one in enumerate(named) if one.found is dropped)
    left = named[:at] + named[at + 1 :]
    last = len(left) - 1
    before = named[min(at, last)].before
    for i in range(min(at, last), last + 1):
        there = after
        if i < last:
            those = [one.found for one in left[: i + 1] if isinstance(one.found, FittedEffect)]
            fit = together(case.fit, those, after.case.fit)
            there = check_bead(replace(case, fit=fit), random)
        left[i] = replace(left[i], before=before, after=there)
        before = there
    return left


def without_unclear_third(
    named: list[Named], check: BeadCheck, nearest: Rejected | None
) -> tuple[list[Named], BeadCheck, Rejected | None]:
    """Drop a third effect of the spectrum that is not unmistakable.

    Parameters
    ----------
    named : in the order found, corrections first. check : with all of them. nearest : as yet.
    """
    fitted = [one.found for one in named if isinstance(one.found, FittedEffect)]
    if len(fitted) < 3 or fitted[-1].net >= THIRD_NATS:
        return named, check, nearest
    third = fitted[-1]
    reason = (
        f"gains {third.gain:.1f} in ln likelihood, too little for a third effect "
        f"({third.penalty + THIRD_NATS:.1f} are needed), as one cause that is not in the catalogue "
        "can look like several"
    )
    return named[:-1], named[-1].before, Rejected(third, reason)


def certain(named: list[Named]) -> list[Named]:
    """The effects that may be named beside an unexplained rest, up to the first that may not."""
    kept: list[Named] = []
    for one in named:
        little = explained_share(one.before, one.after) < MOST_OF_IT
        p_before, p_after = comparable_p_values(one.before, one.after)
        still_odd = p_after < p_before ** (1 - MOST_OF_IT)
        if isinstance(one.found, FittedEffect) and (little or still_odd):
            break
        kept.append(one)
    return kept
