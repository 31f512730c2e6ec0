"""Sets of causes and what each is worth.

A set's score is the ln likelihood of its fit, less half of ln of the number of ordinates for each
parameter, less the ln of the catalogue's length for each cause; a term of known form costs 10 nats
more.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mtpipe.diagnosis.explanation import ALIKE_NATS
from mtpipe.diagnosis.prior import CAUSE_NATS, TERM_NATS
from mtpipe.diagnosis.refit import begun_again, best_formula
from mtpipe.effects.effect import Effect, Evidence
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import (
    FittedEffect,
    gained_by_motion,
    happens,
    lost_without,
    together,
    try_effects,
)
from mtpipe.joint_fit.score_test import MOST_FORMS, most_promising

# Sets of each size that are followed.
BEAM = 2
# Members that are exchanged for others where simulations refuse a set: one cause that stands for
# two gives way to the two.
WEAKEST = 2
# Rivals of the strongest cause on which it is fitted too: what it took for its own as the first of
# two may be theirs, and its fit may stay where that led it.
RIVALS = 3
# Causes that are fitted as the next of a set: those that promise most by the score test.
MOST_NAMES = 6
# A member whose loss by the curvature of ln likelihood (Wald) is 3 times its price is kept without
# a fit that leaves it out: for less the curvature alone is not exact enough.
CLEARLY_NEEDED = 3.0


@dataclass(frozen=True, eq=False)
class Causes:
    """A set of causes, fitted together.

    Attributes
    ----------
    members : in the order in which they were found. fit : with all of them.
    score : ln likelihood gained, less the price of all members (nats).
    objection : what simulations say against it (nats): ln of 0.2 over its p-value, 0 for a larger
        p-value and where it was not simulated.
    """

    members: tuple[FittedEffect, ...]
    fit: ConfiguredFit
    score: float
    objection: float = 0.0

    @property
    def worth(self) -> float:
        """What likelihood and simulations together say for it (nats)."""
        return self.score - self.objection

    @property
    def names(self) -> frozenset[str]:
        """Of the members."""
        return frozenset(one.effect.name for one in self.members)


def causes_of(
    members: tuple[FittedEffect, ...], fit: ConfiguredFit, without: ConfiguredFit
) -> Causes:
    """A set with its score; `without` : the fit without any of it."""
    gain = fit.log_likelihood - without.log_likelihood
    return Causes(members, fit, gain - sum(price(one) for one in members))


def price(one: FittedEffect) -> float:
    """Nats that a member must gain: ½ ln of the number of ordinates for each parameter, and its
    prior odds, ln 27 of a cause and 10 more of a term.
    """
    return one.penalty + (TERM_NATS if one.effect.form else CAUSE_NATS)


def allowed(beside: Causes, one: Effect) -> float:
    """Nats of its price that the next member of a set need not gain: the odds against it, as far as
    simulations object to the set, for then there is something that it lacks. Of a term those remain
    that each cause has.
    """
    return min(beside.objection, TERM_NATS - CAUSE_NATS if one.form else CAUSE_NATS)


def by_score(one: Causes) -> float:
    """For sorting."""
    return one.score


def leads(best: Causes, others: Sequence[Causes]) -> bool:
    """Whether each cause of a set has most of the weight of all sets that were weighed."""
    return all(
        weight_without(one.effect.name, best, others) < 1
        for one in best.members
        if not one.effect.form
    )


def worth_in_any(best: Causes, others: Sequence[Causes]) -> float:
    """What is said for the causes of a set: its score, or what a set is worth that has more
    besides. One more may gain too little to be named, and is no reason against the others.
    """
    return max([best.score, *(one.worth for one in others if one.names > best.names)])


def weight_without(name: str, best: Causes, others: Sequence[Causes]) -> float:
    """Weight of the sets without a cause, over the best set's.

    Members that take each other's place are for `Named.alternatives` to say: a set that differs by
    one of them counts for both.
    """
    return sum(
        math.exp(min(one.worth - best.worth, 0.0))
        for one in others
        if name not in one.names and len(best.names - one.names) > 1
    )


def grown(
    beam: Sequence[Causes],
    without: ConfiguredFit,
    members: Sequence[Effect],
    evidence: Evidence,
    weighed: dict[frozenset[str], Causes],
) -> tuple[list[Causes], FittedEffect | None]:
    """The best few of the sets with one member more, less those that it makes needless, and of the
    causes that were tried the one that was most nearly worth its price.

    One that has grown from each set comes before any second: what is likelier now may be a dead
    end. Where the likeliest has a term, the likeliest of causes alone is followed beside it: a term
    of many numbers can do what several causes do together, and leaves none of them a gain.

    Parameters
    ----------
    weighed : all sets as yet; new ones are added.
    """
    firsts: list[Causes] = []
    seconds: list[Causes] = []
    strongest: list[FittedEffect] = []
    for one in beam:
        children: list[Causes] = []
        causes = [member for member in members if not member.form]
        forms = [member for member in members if member.form]
        promising = most_promising(one.fit, causes, evidence, MOST_NAMES)
        promising |= most_promising(one.fit, forms, evidence, MOST_FORMS)
        able = [member for member in members if member.name in promising]
        tried = try_effects(one.fit, able, evidence, beside=bool(one.members), only=promising)
        lacking = {other: price(other) - allowed(one, other.effect) - other.gain for other in tried}
        by_net = sorted(tried, key=lambda other: lacking[other])
        by_cause = [other for other in by_net if not other.effect.form][:1]
        strongest += by_cause
        for other in dict.fromkeys([*by_net[:BEAM], *by_cause]):
            if lacking[other] < 0 and _is_seen(other):
                children += _news(_needed(without, (*one.members, other), other.fit), weighed)
        children.sort(key=by_score, reverse=True)
        if children:
            rivals = [other for other in by_net if not other.effect.form and lacking[other] < 0]
            for larger in _on_rivals(children[0], one, rivals, without, evidence):
                children += _news(larger, weighed)
            children.sort(key=by_score, reverse=True)
        firsts += children[:1]
        seconds += children[1:]
    firsts.sort(key=by_score, reverse=True)
    seconds.sort(key=by_score, reverse=True)
    # what is tried is not fitted to the end, and lineages are compared by what they come to
    beam = [begun_afresh(one) for one in _followed([*firsts, *seconds])]
    weighed |= {one.names: one for one in beam}
    return beam, max(strongest, key=lambda other: other.gain - price(other), default=None)


def _is_seen(one: FittedEffect) -> bool:
    """Whether it happens at all, and not all of it but its motion fits as well."""
    return happens(one) and gained_by_motion(one) >= ALIKE_NATS


def _news(larger: Causes, weighed: dict[frozenset[str], Causes]) -> list[Causes]:
    """The set, kept among those weighed, where it is new or has come to a better optimum by another
    way; nothing else.
    """
    known = weighed.get(larger.names)
    if known is not None and larger.score <= known.score + ALIKE_NATS:
        return []
    weighed[larger.names] = larger
    return [larger]


def _on_rivals(
    best: Causes,
    smaller: Causes,
    rivals: Sequence[FittedEffect],
    without: ConfiguredFit,
    evidence: Evidence,
) -> list[Causes]:
    """Sets of the newest member of the best set and each of a few rivals, fitted after the rival,
    that are worth more than the best set.

    Parameters
    ----------
    smaller : the set without the newest member, with which the rivals were fitted.
    """
    newest = best.members[-1]
    found = []
    others = (one for one in rivals if one.effect.name not in best.names)
    for rival in itertools.islice(filter(_is_seen, others), RIVALS):
        for again in try_effects(rival.fit, [newest.effect], evidence, beside=True):
            pair = causes_of((*smaller.members, rival, again), again.fit, without)
            if pair.score > best.score and _is_seen(again):
                found.append(_needed(without, pair.members, pair.fit))
    return found


def _followed(grown_sets: Sequence[Causes]) -> list[Causes]:
    """The sets that are grown further, of those in the order in which they are to be."""
    of_causes = [one for one in grown_sets if not any(each.effect.form for each in one.members)]
    if grown_sets and of_causes and grown_sets[0] not in of_causes:
        return [grown_sets[0], max(of_causes, key=by_score)]
    return list(grown_sets[:BEAM])


def exchanged(
    best: Causes,
    without: ConfiguredFit,
    members: Sequence[Effect],
    evidence: Evidence,
    weighed: dict[frozenset[str], Causes],
) -> None:
    """Weigh the sets with another member in the place of one of the two weakest.

    Parameters
    ----------
    weighed : all sets as yet; new ones are added.
    """
    by_loss = sorted(best.members, key=lambda one: lost_without(best.fit, one.hypothesis))
    fewer = []
    for one in by_loss[:WEAKEST]:
        rest = tuple(other for other in best.members if other is not one)
        try:
            fewer.append(causes_of(rest, together(without, rest, best.fit), without))
        except (FitError, ValueError):
            continue
    grown(fewer, without, members, evidence, weighed)


def likelier_by_exchange(
    best: Causes,
    without: ConfiguredFit,
    members: Sequence[Effect],
    evidence: Evidence,
    weighed: dict[frozenset[str], Causes],
) -> Causes | None:
    """The likeliest set that was not weighed yet and has another member in the place of one of the
    two weakest, if it is likelier than the best set.

    Parameters
    ----------
    weighed : all sets as yet; new ones are added.
    """
    known = set(weighed)
    exchanged(best, without, members, evidence, weighed)
    news = [one for names, one in weighed.items() if names not in known]
    other = max(news, key=by_score, default=best)
    return other if other.score > best.score else None


def likeliest_left(
    weighed: Mapping[frozenset[str], Causes], refused: Sequence[Causes]
) -> Causes | None:
    """The likeliest of the sets that may still be judged better than those that simulations refuse,
    none of which it is a part of or contains; None where there is none.
    """
    least = max(one.worth for one in refused)
    left = [
        one
        for one in weighed.values()
        if one.score > least
        and not any(one.names <= other.names or one.names >= other.names for other in refused)
    ]
    return max(left, key=by_score, default=None)


def objected(one: Causes, refused: Sequence[Causes]) -> Causes:
    """A set with what simulations say against the refused sets that it is a part of or contains: it
    was not simulated itself, and has the same fault or would have been gone on with.
    """
    alike = [
        other.objection for other in refused if one.names <= other.names or one.names >= other.names
    ]
    return replace(one, objection=max([one.objection, *alike]))


def _needed(
    without: ConfiguredFit, members: tuple[FittedEffect, ...], fit: ConfiguredFit
) -> Causes:
    """The set without members whose price is more than the others lose without them."""
    for one in members[:-1]:
        if lost_without(fit, one.hypothesis) > CLEARLY_NEEDED * price(one):
            continue
        rest = tuple(other for other in members if other is not one)
        try:
            fewer = together(without, rest, fit)
        except (FitError, ValueError):
            continue
        if fit.log_likelihood - fewer.log_likelihood < price(one):
            members, fit = rest, fewer
    return causes_of(members, fit, without)


def begun_afresh(one: Causes) -> Causes:
    """The set with forces begun afresh and the formula of the chain that suits it best: what was
    chosen without any of it may be wrong with it.
    """
    try:
        fit = best_formula(begun_again(one.fit))
    except (FitError, ValueError):
        return one
    return replace(one, fit=fit, score=one.score + fit.log_likelihood - one.fit.log_likelihood)
