"""Causes weighed as sets, by what they explain together.

A real recording has four or five causes. Each by itself explains little, and with one of them alone
recording and simulation may differ even more, so a set of causes is weighed as a whole
(`mtpipe.diagnosis.causes`). Sets grow by one member at a time, the two best of each size. At the
end the set is compared with simulations: if recording and simulation do not agree with all of it,
none of it is named. Nor is any where other sets, without one of its causes, have as much weight.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.crosschecking.check import (
    ENOUGH,
    ROUNDS,
    BeadCheck,
    check_bead,
)
from mtpipe.diagnosis.alternatives import Place, or_by_form, place_of, with_alternatives
from mtpipe.diagnosis.causes import (
    BEAM,
    Causes,
    by_score,
    causes_of,
    exchanged,
    grown,
    leads,
    likeliest_left,
    objected,
    price,
    settled,
    weight_without,
    worth_in_any,
)
from mtpipe.diagnosis.evidence import evidence_of
from mtpipe.diagnosis.explanation import ALIKE_NATS, Named, agrees, ln_of
from mtpipe.diagnosis.heldout import heldout_gain
from mtpipe.diagnosis.judging import (
    better_judged,
    checked_with,
    contradicted,
    hopeful,
    judged,
    lacked_by,
    rejected,
)
from mtpipe.diagnosis.probability import smooth_gain, unknown_nats, weight
from mtpipe.diagnosis.single_events import unseen_member
from mtpipe.diagnosis.unexplained import Rejected
from mtpipe.diagnosis.why_not import gains_in_words, too_little
from mtpipe.effects.effect import Effect
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import (
    FittedEffect,
    together,
)
from mtpipe.terms.catalogue import TERMS

# A set whose next member gains 20 nats or more is not complete, and is not simulated yet.
UNDISPUTED_NATS = 20.0
# With p of 0.2 or more a further member must gain 7 nats beyond its price: models are approximate,
# and what one leaves can imitate another cause. With less, by ln of p over 0.2 less.
FORM_NATS = 7.0
# Most members that are added; real recordings have up to six.
MOST_STEPS = 12
# Sets that may be refused before nothing is named, each judged better than those before: one costs
# as much as a step of the search.
MOST_REFUSED = 4
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
    """

    named: list[Named]
    check: BeadCheck
    nearest: Rejected | None = None
    corrections: tuple[Named, ...] = ()


def _nothing_else(check: BeadCheck) -> Weighed | None:
    return None


def several_causes(
    first: BeadCheck,
    begun: BeadCheck,
    effects: Sequence[Effect],
    random: np.random.Generator,
    say: Callable[[str], None],
    instead: Callable[[BeadCheck], Weighed | None] = _nothing_else,
) -> Weighed:
    """Weigh causes as sets.

    Parameters
    ----------
    first : the bead's first check. begun : with what was taken off the traces in time, if anything.
    instead : what is found in another way, if anything, where simulations object to a set: asked
        before a cause is blamed for what may not be its own.
    """
    without = begun.case.fit
    nothing = Causes((), without, 0.0)
    members: tuple[Effect, ...] = (*effects, *TERMS)
    weighed: dict[frozenset[str], Causes] = {}
    best, beam, check = nothing, [nothing], begun
    rivals: list[Causes] = []
    refused: list[Refused] = []
    first_tried: FittedEffect | None = None
    agreed: list[tuple[Causes, BeadCheck]] = []
    for _ in range(MOST_STEPS):
        say("weighing causes beside " + (", ".join(sorted(best.names)) or "none"))
        # the better the fit, the more of what differs is seen as what it is
        evidence = evidence_of(replace(begun, case=replace(begun.case, fit=best.fit)))
        beam, strongest = grown(beam, without, members, evidence, weighed)
        first_tried = first_tried or strongest
        next_best = max(beam, key=by_score, default=best)
        gained = next_best.score - best.score
        if best.members and gained < UNDISPUTED_NATS:
            # what is left is small: is it anything?
            say("checking with " + ", ".join(sorted(best.names)))
            try:
                check = checked_with(best, begun, first, random)
            except (FitError, ValueError) as error:
                refused.append(Refused(best, check, f"the bead cannot be simulated ({error})"))
                break
            wrong = unseen_member(begun.case, best, weighed.values(), random)
            if not wrong and agrees(check, first):
                agreed.append((best, check))
                if gained < FORM_NATS + ln_of(check.p_value) - ln_of(1.0):
                    agreed[-1] = better_judged(best, check, rivals, begun, random)[:2]
                    break
            if not (wrong or agreed) and (other_way := instead(check)) is not None:
                return other_way
            wrong = wrong or contradicted(begun, best, check, random)
            if wrong:
                say(f"without {wrong}, which is not how positions are distributed")
                members = tuple(one for one in members if one.name != wrong)
                weighed = {names: one for names, one in weighed.items() if wrong not in names}
                beam = sorted([nothing, *weighed.values()], key=by_score, reverse=True)[:BEAM]
                best = beam[0]
                continue
            if gained < hopeful(check):
                why = f"recording and simulation differ (p {check.p_value:.1g})"
                best = weighed[best.names] = judged(best, check)
                say("looking for what it lacks")
                larger = lacked_by(best, check, without, TERMS, evidence, weighed)
                if larger is not None:
                    best, beam, rivals = larger, [larger], []
                    continue
                refused.append(Refused(best, check, why))
                if agreed or len(refused) == MOST_REFUSED or in_vain(refused):
                    break
                say("weighing other sets")
                exchanged(best, without, members, evidence, weighed)
                other = likeliest_left(weighed, [one.causes for one in refused])
                if other is None:
                    break
                best, beam, rivals = other, [other], []
                continue
        if gained <= 0:
            break
        best = next_best
        rivals = [one for one in beam if one is not best and best.score - one.score < ALIKE_NATS]
    if not agreed and refused:
        nearly = max(refused, key=lambda one: one.causes.worth)
        nearest = rejected(nearly.causes, nearly.why) or _nearest(
            first_tried, nearly.causes, without
        )
        return Weighed([], nearly.check, nearest)
    if not agreed:
        return Weighed([], check, _nearest(first_tried, best, without))
    against = [one.causes for one in refused]
    able = [one for one in members if not one.form]
    told = []
    # a larger set may have more likelihood, and not agree; or agree, and have a member for which
    # there is no more to be said than that
    for best, check in reversed(agreed):
        others = [objected(one, against) for names, one in weighed.items() if names != best.names]
        told.append(_named(best, others, begun, check, first, random, able))
        if told[-1].named:
            return told[-1]
    return told[0]


@dataclass(frozen=True, eq=False)
class Refused:
    """A set that simulations do not agree with, its check, and why in words."""

    causes: Causes
    check: BeadCheck
    why: str


def in_vain(refused: Sequence[Refused]) -> bool:
    """Whether the last of the sets is judged no better than those before."""
    *before, last = (one.causes.worth for one in refused)
    return bool(before) and last <= max(before)


def _nearest(
    strongest: FittedEffect | None, best: Causes, without: ConfiguredFit
) -> Rejected | None:
    """The strongest cause by itself, where no set with a cause was compared with simulations."""
    if strongest is None:
        return None
    fit = settled(causes_of((strongest,), strongest.fit, without)).fit
    gain = fit.log_likelihood - without.log_likelihood
    strongest = replace(strongest, fit=fit, gain=gain)
    if strongest.gain <= price(strongest):
        return Rejected(strongest, too_little(strongest, price(strongest)))
    instead = ", ".join(sorted(best.names))
    return Rejected(
        strongest, f"{gains_in_words(strongest)}, less than forms without a name ({instead})"
    )


def _named(
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
        one = with_alternatives(one, best.names, place, check, sets, left_smooth)
        likely = or_by_form(one)
        if likely is None:
            why = f"something that has no name is likelier in the place of {one.name}"
            return Weighed([], check, rejected(best, why))
        told.append(likely)
    return Weighed(told, check)


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
