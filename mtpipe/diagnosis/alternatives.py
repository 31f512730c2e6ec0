"""What could stand in the place of a named effect: effects that the recording cannot tell from it,
and how sure its name is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial

from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.diagnosis.explanation import ALIKE_NATS, Alternative, Named
from mtpipe.diagnosis.heldout import heldout_gain
from mtpipe.diagnosis.probability import odds_against, odds_against_correction
from mtpipe.diagnosis.refit import begun_again
from mtpipe.diagnosis.sets import MOST_FORMS
from mtpipe.diagnosis.superfluous import SEEN_NATS
from mtpipe.effects.effect import Effect
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import FittedEffect, together, try_effects
from mtpipe.joint_fit.score_test import most_promising
from mtpipe.terms.catalogue import TERMS

# What effects gain on time that was not fitted is compared where their net gains differ by no more:
# ordinates that are less independent than they are taken for make as much of a difference where
# they were fitted.
NEAR_NATS = 20.0
# Effects that are fitted in the place of one that is named, of those that one look at the fit is
# enough for: what is as good promises as much.
MOST_ALIKE = 10


def with_alternatives(
    one: Named, named: Sequence[Named], case: PreparedBead, effects: Sequence[Effect]
) -> Named:
    """The effect with what the recording cannot tell from it, given the others that are named."""
    if not isinstance(one.found, FittedEffect):
        return replace(one, odds_against=odds_against_correction(one.before))
    if one.form:
        return one  # a term has no name that others could have instead
    fitted = [other.found for other in named if isinstance(other.found, FittedEffect)]
    others = [other for other in fitted if other is not one.found]
    try:
        # where it is far from the data its forces are found afresh: what it gains by these is no
        # matter of any effect, and all of them would be fitted to the end for it
        without = begun_again(together(case.fit, others, named[-1].after.case.fit))
    except (FitError, ValueError):
        return replace(one, alternatives=())
    evidence = one.found.evidence
    rivals = [other for other in effects if other.name != one.name]
    promising = most_promising(without, rivals, evidence, MOST_ALIKE)
    if any(other.form for other in named):
        promising |= most_promising(without, TERMS, evidence, MOST_FORMS)
    weighed = [
        other for other in (*effects, *TERMS) if other.name in promising or other.name == one.name
    ]
    tried = try_effects(without, weighed, evidence, beside=bool(others), only=promising)
    return among_tried(one, tried, {other.name for other in named}, case, without)


def among_tried(
    one: Named,
    tried: Sequence[FittedEffect],
    names: Collection[str],
    case: PreparedBead,
    without: ConfiguredFit,
) -> Named:
    """The effect with those of all that were tried as it was, none of them better fitted than the
    others, which are alike and not named; and how sure its name is.

    Parameters
    ----------
    without : fit with the others that are named.
    """
    own = next((other for other in tried if other.effect.name == one.name), None)
    if own is None:
        return replace(one, alternatives=())
    alternatives = alike(own, tried, names, partial(_foretold, case))
    beside = {*names, *(other.found.effect.name for other in alternatives)}
    against = odds_against(own, tried, beside, without, one.after.case.fit)
    return replace(one, alternatives=alternatives, odds_against=against)


def _foretold(case: PreparedBead, one: FittedEffect, other: FittedEffect) -> float:
    """How much better an effect than another tells time that was not fitted, in nats."""
    return heldout_gain(case, other.fit, one.fit)


def alike(
    one: FittedEffect,
    tried: Sequence[FittedEffect],
    named: Collection[str],
    foretold: Callable[[FittedEffect, FittedEffect], float],
) -> tuple[Alternative, ...]:
    """Effects, not named themselves, that the recording cannot tell from this one: by ln
    likelihood, by net gain after BIC, or by what they gain on time that was not fitted.

    Parameters
    ----------
    tried : all of them, this one too. named : names of those that are named.
    foretold : how much better the first of two tells time that was not fitted; nan where that is
        not known: then they are alike if each would be seen by itself.
    """

    def as_well(other: FittedEffect) -> bool:
        if abs(other.net - one.net) < ALIKE_NATS or one.gain - other.gain < ALIKE_NATS:
            return True
        if one.net - other.net >= NEAR_NATS:
            return False
        nats = foretold(one, other)
        return other.net >= SEEN_NATS if math.isnan(nats) else nats < ALIKE_NATS

    return tuple(
        Alternative(other, other.net - one.net)
        for other in tried
        if other.effect.name not in named and not other.effect.form and as_well(other)
    )
