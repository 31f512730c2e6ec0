"""What could stand in the place of a named effect: effects that the recording cannot tell from it,
and how sure its name is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

from mtpipe.crosschecking.check import BeadCheck
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.diagnosis.explanation import ALIKE_NATS, Alternative, Named
from mtpipe.diagnosis.heldout import heldout_gain
from mtpipe.diagnosis.probability import odds_against
from mtpipe.diagnosis.refit import begun_again
from mtpipe.effects.effect import Effect
from mtpipe.effects.terms.catalogue import TERMS
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import FittedEffect, happens, together, try_effects
from mtpipe.joint_fit.score_test import MOST_FORMS, most_promising

# Held-out gains are compared of causes whose net gains differ by less than 20 nats: ordinates that
# are not quite independent can make that much of a difference where they were fitted.
NEAR_NATS = 20.0
# A name is given that is likelier than not, alternatives with it.
MOST_LIKELY = 0.5
# Net gain from which an effect is seen by itself.
SEEN_NATS = 4.0
# Causes that are fitted in the place of a named one: those that promise most by the score test.
MOST_ALIKE = 10


@dataclass(frozen=True, eq=False)
class Place:
    """The place of one member in a set of causes.

    Attributes
    ----------
    own : the member, fitted there as the others were; None if it cannot be.
    tried : all that were fitted there, best first. without : fit with the other members alone.
    """

    own: FittedEffect | None
    tried: list[FittedEffect]
    without: ConfiguredFit


def place_of(
    one: FittedEffect,
    members: Sequence[FittedEffect],
    without: ConfiguredFit,
    fit: ConfiguredFit,
    effects: Sequence[Effect],
) -> Place | None:
    """What else of the catalogue could be in a member's place; None where nothing can be said.

    Parameters
    ----------
    members : of the set. without : fit without any of them. fit : with all of them.
    """
    others = [other for other in members if other is not one]
    try:
        # if this fit is far from the data it is begun again with new forces; otherwise every effect
        # would gain by the better forces, and all of them would be fitted to the end
        rest = begun_again(together(without, others, fit))
    except (FitError, ValueError):
        return None
    names = {other.effect.name for other in members}
    able = [other for other in effects if other.name not in names]
    promising = most_promising(rest, able, one.evidence, MOST_ALIKE)
    if any(other.effect.form for other in members):
        promising |= most_promising(rest, TERMS, one.evidence, MOST_FORMS)
    weighed = [other for other in (*able, *TERMS) if other.name in promising]
    weighed.append(one.effect)
    tried = try_effects(rest, weighed, one.evidence, beside=bool(others), only=promising)
    tried = [
        _as_in_set(each, fit, rest) if _is(each, one) else each
        for each in tried
        if _is(each, one) or happens(each)
    ]
    return Place(next((each for each in tried if _is(each, one)), None), tried, rest)


def _is(one: FittedEffect, other: FittedEffect) -> bool:
    return one.effect.name == other.effect.name


def _as_in_set(own: FittedEffect, whole: ConfiguredFit, without: ConfiguredFit) -> FittedEffect:
    """A member as its set has it, where a fit that begins without it ends in a lower optimum."""
    gain = whole.log_likelihood - without.log_likelihood
    return replace(own, fit=whole, gain=gain) if gain > own.gain else own


def with_alternatives(
    one: Named,
    names: Collection[str],
    place: Place | None,
    last: BeadCheck,
    sets: float,
    left_smooth: float,
) -> Named:
    """A named effect with what the recording cannot tell from it, given the others that are named;
    and how sure its name is.

    Parameters
    ----------
    names : of all that are named. last : the check with all of them.
    sets : weight of all sets without it, over that of the set that is named.
    left_smooth : what a smooth factor gains beside all of them, nats.
    """
    if one.form:
        return one  # a term has no name that others could have instead
    if place is None or place.own is None:
        return replace(one, alternatives=())
    alternatives = indistinguishable(place.own, place.tried, names, partial(_foretold, last.case))
    beside = {*names, *(other.found.effect.name for other in alternatives)}
    against = odds_against(place.own, place.tried, beside, place.without, left_smooth)
    return replace(one, alternatives=alternatives, odds_against=against + sets)


def or_by_form(one: Named) -> Named | None:
    """The named effect; if it and all its alternatives together are less likely than not, the term
    that describes what it does, or None if no term does.
    """
    if one.form or one.probability_of_any >= MOST_LIKELY or not isinstance(one.found, FittedEffect):
        return one
    form, axes = one.found.effect.unnamed
    if not form:
        return None
    effect = replace(one.found.effect, form=form, axes=axes)
    if effect.single is not None:
        effect = replace(effect, cause=effect.single.power)
    return replace(one, found=replace(one.found, effect=effect), alternatives=())


def _foretold(case: PreparedBead, one: FittedEffect, other: FittedEffect) -> float:
    """By how many nats one effect predicts held-out time better than another."""
    return heldout_gain(case, other.fit, one.fit)


def indistinguishable(
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
    foretold : by how many nats the first of two predicts held-out time better; nan where that is
    not known: then the other counts as indistinguishable if it would be seen by itself.
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
