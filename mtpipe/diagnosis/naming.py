"""What is named of a set of causes with which recording and simulation agree.

Each member keeps its place only if nothing else in it is likelier, if it gains on time that was not
fitted, and if sets without it have less weight. If one does not, the set is not named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.crosschecking.check import ENOUGH, ROUNDS, BeadCheck, check_bead
from mtpipe.diagnosis.alternatives import Place, or_by_form, place_of, with_alternatives
from mtpipe.diagnosis.causes import (
    Causes,
    by_score,
    causes_of,
    leads,
    price,
    weight_without,
    worth_in_any,
)
from mtpipe.diagnosis.explanation import Named, agrees, ln_of
from mtpipe.diagnosis.heldout import heldout_gain
from mtpipe.diagnosis.judging import better_judged, checked_with, rejected
from mtpipe.diagnosis.prior import CAUSE_NATS, TERM_NATS
from mtpipe.diagnosis.probability import smooth_gain, unknown_nats, weight
from mtpipe.diagnosis.single_events import odds_of_smooth
from mtpipe.diagnosis.unexplained import Rejected
from mtpipe.effects.effect import Effect
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import FittedEffect, together

# With p of 0.2 or more a further member must gain 7 nats beyond its price: models are approximate,
# and what one leaves can imitate another cause. With less, by ln of p over 0.2 less.
FORM_NATS = 7.0
# Sets that are simulated, with another cause in the place of a named one, as they are likelier.
MOST_RIVALS = 4
# Numbers of simulations of a part of a set.
SEARCHING = tuple(goal for goal in ROUNDS if goal <= ENOUGH)


@dataclass(frozen=True, eq=False)
class Weighed:
    """What weighing ends with.

    Attributes
    ----------
    named : the causes and terms that together make recording and simulation agree, in the order
        found; none where they do not, or where others weigh as much.
    check : with the last set that was compared with simulations; where none was, without any.
    nearest : the cause that came nearest where none is named, and why; None if none could be tried.
    corrections : what is seen in time only beside causes, and was taken off before weighing these.
    unfinished : whether there would have been ever more causes.
    """

    named: list[Named]
    check: BeadCheck
    nearest: Rejected | None = None
    corrections: tuple[Named, ...] = ()
    unfinished: bool = False


def last_named(
    agreed: Sequence[tuple[Causes, BeadCheck]], told: Callable[[Causes, BeadCheck], Weighed]
) -> Weighed:
    """What is named of the last set that agrees and can be named; where none can, why the last one
    is not. One more member may make a set likelier, and have nothing else that speaks for it.

    Parameters
    ----------
    agreed : sets that simulations agree with, in the order in which they grew, and their checks.
    told : what is named of a set.
    """
    ends = []
    for best, check in reversed(agreed):
        ends.append(told(best, check))
        if ends[-1].named:
            return ends[-1]
    return ends[0]


def named_of(
    best: Causes,
    others: Sequence[Causes],
    begun: BeadCheck,
    check: BeadCheck,
    first: BeadCheck,
    random: np.random.Generator,
    effects: Sequence[Effect],
) -> Weighed:
    """The members of a set with which recording and simulation agree, or why none is named."""
    if not leads(best, others):
        return Weighed([], check, rejected(best, "causes without it are as likely"))
    best, check, places = _exchanged(best, begun, check, random, effects)
    while (fewer := _without_weakest(best, check, places, begun, first, random)) is not None:
        best, check = fewer
        best, check, places = _exchanged(best, begun, check, random, effects)
    left_smooth = smooth_gain(best.fit)
    unknown = unknown_nats(begun.case.fit, left_smooth, worth_in_any(best, others))
    if unknown > 0:
        why = "something smooth that has no name explains as much"
        return Weighed([], check, rejected(best, why))
    try:
        named = in_order_found(begun, best, check, random)
    except (FitError, ValueError) as error:
        why = f"the bead cannot be simulated with the first of them alone ({error})"
        return Weighed([], check, rejected(best, why))
    if not named:
        return Weighed([], check, rejected(best, "nothing in data kept out of the fit"))
    told = []
    for one, place in zip(named, places, strict=True):
        sets = weight(unknown) + weight_without(one.name, best, others)
        if isinstance(one.found, FittedEffect):
            smooth = odds_of_smooth(begun.case, best.fit, one.found, random)
            sets += smooth
            place = as_dear_as_a_term(place) if smooth > 0 else place
        one = with_alternatives(one, best.names, place, check, sets, left_smooth)
        likely = or_by_form(one)
        if likely is None:
            why = f"something that has no name is likelier in the place of {one.name}"
            return Weighed([], check, rejected(best, why))
        told.append(likely)
    return Weighed(told, check)


def as_dear_as_a_term(place: Place | None) -> Place | None:
    """The place of a member whose events traces do not clearly show: it fits as many recordings as
    a term does.
    """
    if place is None or place.own is None:
        return place
    dearer = place.own.penalty + TERM_NATS - CAUSE_NATS
    return replace(place, own=replace(place.own, penalty=dearer))


def _without_weakest(
    best: Causes,
    check: BeadCheck,
    places: Sequence[Place | None],
    begun: BeadCheck,
    first: BeadCheck,
    random: np.random.Generator,
) -> tuple[Causes, BeadCheck] | None:
    """The set without its weakest member, and its check; None where that is worth its place.

    What the last member has to gain each has, whatever the order in which they were found.
    """
    if len(best.members) < 2:
        return None
    margins = [
        math.inf if place is None or place.own is None else place.own.gain - price(place.own)
        for place in places
    ]
    k = int(np.argmin(margins))
    place = places[k]
    if place is None or margins[k] >= FORM_NATS:
        return None
    rest = causes_of((*best.members[:k], *best.members[k + 1 :]), place.without, begun.case.fit)
    try:
        fewer = checked_with(rest, begun, first, random)
    except (FitError, ValueError):
        return None
    if agrees(fewer, first) and margins[k] < FORM_NATS + ln_of(fewer.p_value) - ln_of(1.0):
        return rest, fewer
    return None


def _exchanged(
    best: Causes,
    begun: BeadCheck,
    check: BeadCheck,
    random: np.random.Generator,
    effects: Sequence[Effect],
) -> tuple[Causes, BeadCheck, list[Place | None]]:
    """The set with other effects in the places of its members, where likelihood and battery
    together speak for them, its check, and what there is in each place.
    """
    without = begun.case.fit
    objections: dict[frozenset[str], float] = {}
    while True:
        places = [place_of(one, best.members, without, best.fit, effects) for one in best.members]
        rivals = [
            causes_of(
                tuple(other if each is one else each for each in best.members), other.fit, without
            )
            for one, place in zip(best.members, places, strict=True)
            for other in (place.tried if place else [])
            if other.effect.name not in best.names
        ]
        rivals = [one for one in rivals if one.score > best.score and one.names not in objections]
        rivals.sort(key=by_score, reverse=True)
        better, its_check, said = better_judged(best, check, rivals[:MOST_RIVALS], begun, random)
        objections |= said
        if better is best:
            return best, check, [_objected(place, best.names, objections) for place in places]
        if of_fitted_time_only(begun, better, its_check):
            objections[better.names] = math.inf
        else:
            best, check = better, its_check


def _objected(
    place: Place | None, names: frozenset[str], objections: Mapping[frozenset[str], float]
) -> Place | None:
    """A place in which rivals pay for what simulations say against the set with them."""
    if place is None or place.own is None:
        return place
    rest = names - {place.own.effect.name}
    tried = [
        replace(one, penalty=one.penalty + max(objections.get(rest | {one.effect.name}, 0.0), 0.0))
        for one in place.tried
    ]
    return replace(place, tried=sorted(tried, key=lambda one: one.net, reverse=True))


def in_order_found(
    begun: BeadCheck, causes: Causes, last: BeadCheck, random: np.random.Generator
) -> list[Named]:
    """The members with the checks before and after each, and what each gains on time that was not
    fitted; none where one gains nothing there.

    Raises
    ------
    FitError, ValueError : the bead cannot be simulated with the first few of them alone.
    """
    case, before, named = begun.case, begun, list[Named]()
    for count, one in enumerate(causes.members, start=1):
        heldout = _heldout(case.fit, causes, one, last)
        if heldout <= 0:
            return []
        after = last
        if count < len(causes.members):
            there = together(case.fit, causes.members[:count], last.case.fit)
            after = check_bead(replace(case, fit=there), random, rounds=SEARCHING)
        named.append(Named(replace(one, fit=after.case.fit), (), before, after, heldout))
        before = after
    return named


def of_fitted_time_only(begun: BeadCheck, causes: Causes, last: BeadCheck) -> str:
    """The name of a member that gains nothing on time that was not fitted; empty: none.

    Parameters
    ----------
    begun : without any of the set. last : with all of it.
    """
    for one in causes.members:
        if _heldout(begun.case.fit, causes, one, last) <= 0:
            return one.effect.name
    return ""


def _heldout(without: ConfiguredFit, causes: Causes, one: FittedEffect, last: BeadCheck) -> float:
    """What a member gains on time that was not fitted, beside the others; nan where these cannot be
    without it, as a bead that is seen to turn cannot be one that does not turn.
    """
    rest = [other for other in causes.members if other is not one]
    try:
        fewer = together(without, rest, last.case.fit)
    except (FitError, ValueError):
        return math.nan
    return heldout_gain(last.case, fewer, last.case.fit)
