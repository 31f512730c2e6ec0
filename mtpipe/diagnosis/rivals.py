"""Of effects that are nearly as likely, the one that likelihood and battery together speak for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from mtpipe.corrections.correction import Correction
from mtpipe.crosschecking.check import (
    CLEARLY_CONSISTENT,
)
from mtpipe.diagnosis.explanation import (
    AGREES_P,
    Named,
)
from mtpipe.diagnosis.unexplained import Rejected
from mtpipe.joint_fit.hypotheses import (
    FittedEffect,
)


def better_judged(
    found: Named,
    rivals: Sequence[FittedEffect],
    refitted: Callable[[FittedEffect], FittedEffect],
    checked: Callable[[FittedEffect], Named | Rejected],
) -> Named:
    """Of effects that are nearly as likely, the one that likelihood and battery together speak for.

    A p-value that is clearly consistent is as good as any; below, its ln is lost. A rival takes the
    place only if recording and simulation agree with it.

    Parameters
    ----------
    found : the likeliest, which has been fitted again since. rivals : those that are alike, best
        first. refitted : fits one again, too. checked : checks one.
    """

    for rival in rivals:
        one = refitted(rival)
        if _judged(one, CLEARLY_CONSISTENT) <= _judged(found.found, found.after.p_value):
            continue
        other = checked(one)
        if isinstance(other, Rejected) or other.after.p_value < AGREES_P:
            continue
        found = max(found, other, key=lambda named: _judged(named.found, named.after.p_value))
    return found


def _judged(one: FittedEffect | Correction, p_value: float) -> float:
    """Net gain and ln p; of a correction, which nothing rivals, infinite."""
    net = one.net if isinstance(one, FittedEffect) else math.inf
    return net + ln_of(p_value)


def ln_of(p_value: float) -> float:
    """A p-value that is clearly consistent is as good as any."""
    return math.log(max(min(p_value, CLEARLY_CONSISTENT), 1e-300))
