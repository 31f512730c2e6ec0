"""Whether a fitted effect is kept: its name with its size, or why it is not enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtpipe.crosschecking.check import (
    ENOUGH,
    FAR_OFF,
    ROUNDS,
    BeadCheck,
    check_bead,
    comparable_p_values,
)
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.diagnosis.explanation import (
    ALARM_P,
    ALIKE_NATS,
    Named,
)
from mtpipe.diagnosis.heldout import MOST_OF_IT, explained_share, heldout_gain
from mtpipe.diagnosis.unexplained import Rejected
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.hypotheses import (
    FittedEffect,
    gained_by_motion,
)

# So many effects are checked at most before the search ends, and one is rejected if with it ln p is
# larger than this many times what it was.
MOST_CANDIDATES, MORE_ODD = 3, 1.25
# The search has enough simulations for each of the effects it checks: what comes out of it is made
# sure, as whether recording and simulation agree is said by that alone.
SEARCHING = tuple(goal for goal in ROUNDS if goal <= ENOUGH)
# A p-value of 120 simulations differs tenfold from one set of them to the next where it is small,
# of twice as many fivefold.
SURE_SIMULATIONS = 240


def named_effect(
    one: FittedEffect,
    check: BeadCheck,
    case: PreparedBead,
    random: np.random.Generator,
    *,
    far_off: float = FAR_OFF,
) -> Named | Rejected:
    """The effect, checked; rejected where it is not seen to move, tells nothing of time that was
    not fitted, cannot be simulated, or makes recording and simulation differ even more.

    Parameters
    ----------
    check : without it. case : without any effect. far_off : as `check_bead`.
    """
    without = check.case.fit
    if gained_by_motion(one) < ALIKE_NATS:
        reason = f"{gains_in_words(one)}, but fits no better than a longer tether that does not hop"
        return Rejected(one, reason, unseen=True)
    heldout = heldout_gain(case, without, one.fit)
    if heldout <= 0:
        return Rejected(one, f"{gains_in_words(one)}, but nothing in data kept out of the fit")
    try:
        after = check_bead(replace(case, fit=one.fit), random, rounds=SEARCHING, far_off=far_off)
    except (FitError, ValueError) as error:
        return Rejected(one, f"{gains_in_words(one)}, but cannot be simulated ({error})")
    p_before, p_after = comparable_p_values(check, after)
    if p_after < min(ALARM_P, p_before**MORE_ODD):
        return Rejected(one, _more_odd(one, check, after))
    return Named(one, (), check, after, heldout)


def gains_in_words(one: FittedEffect) -> str:
    """What a fitted effect gains, in words."""
    return f"gains {one.gain:.0f} in ln likelihood"


def too_little(one: FittedEffect, needed: float) -> str:
    """Why an effect's gain does not pay for its numbers, in words."""
    numbers = one.hypothesis.numbers
    gains = f"gains {one.gain:.1f} in ln likelihood" if one.gain >= 0.05 else "gains nothing"
    what = "parameter" if numbers == 1 else f"{numbers} parameters"
    return f"{gains}, too little for its {what} ({one.penalty + needed:.1f} are needed)"


def _more_odd(one: FittedEffect, before: BeadCheck, after: BeadCheck) -> str:
    return (
        f"{gains_in_words(one)}, but with it recording and simulation differ even more "
        f"(p {before.p_value:.1g} → {after.p_value:.1g})"
    )


def not_enough(one: Named) -> str:
    """Why a fitted effect that was simulated is not kept, in words."""
    share = max(explained_share(one.before, one.after), 0.0)
    if share < MOST_OF_IT:
        return (
            f"explains {share:.0%} of the misfit; where something else remains unexplained, a "
            f"cause is named only if it explains {MOST_OF_IT:.0%}"
        )
    return (
        f"explains {share:.0%} of the misfit, but what remains differs about as significantly "
        f"(p {one.before.p_value:.1g} → {one.after.p_value:.1g})"
    )


def heights_off(one: Named, scatter: float) -> str:
    """How far mean heights are off after a fitted effect, in words."""
    return (
        f"explains {max(explained_share(one.before, one.after), 0.0):.0%} of the misfit, but mean "
        "heights scatter by more than positions wander within plateaus (ln likelihood is higher by "
        f"{scatter:.0f} if each height has an error of its own)"
    )
