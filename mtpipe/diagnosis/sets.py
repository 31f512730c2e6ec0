"""Causes weighed as sets, by what they explain together.

A real recording has four or five causes. Each by itself explains little, and with one of them alone
recording and simulation may differ even more, so a set of causes is weighed as a whole. Its score
is the ln likelihood of its fit, less half of ln of the number of ordinates for each parameter, less
the ln of the catalogue's length for each cause; a term of known form costs 10 nats more. Sets grow
by one member at a time, the two best of each size. At the end the set is compared with simulations:
if recording and simulation do not agree with all of it, none of it is named. Nor is any where other
sets, without one of its causes, have as much weight.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.crosschecking.check import (
    CLEARLY_NOT,
    ENOUGH,
    BeadCheck,
    check_bead,
    comparable_p_values,
)
from mtpipe.diagnosis.evidence import evidence_of
from mtpipe.diagnosis.explanation import AGREES_P, ALIKE_NATS, Named, agrees
from mtpipe.diagnosis.heldout import heldout_gain
from mtpipe.diagnosis.kept import SEARCHING, SURE_SIMULATIONS
from mtpipe.diagnosis.probability import CAUSE_NATS, TERM_NATS
from mtpipe.diagnosis.refit import begun_again, best_formula
from mtpipe.diagnosis.rivals import ln_of
from mtpipe.diagnosis.unexplained import SPECTRAL
from mtpipe.effects.effect import Effect, Evidence
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import (
    FittedEffect,
    gained_by_motion,
    lost_without,
    model_with,
    together,
    try_effects,
)
from mtpipe.joint_fit.score_test import most_promising
from mtpipe.terms.catalogue import TERMS

# Sets of each size that are followed: two ways of beginning end in one place where there is one.
BEAM = 2
# Causes and terms that are fitted as the next of a set, of all that one look at its fit is enough
# for.
MOST_NAMES, MOST_FORMS = 6, 3
# A member is kept, without a fit that leaves it out, where by the curvature of ln likelihood the
# set would lose 3 times its price: the curvature alone is not exact enough for less.
CLEARLY_NEEDED = 3.0
# While a set gains more than this by its next member (nats), it is not compared with simulations.
UNDISPUTED_NATS = 20.0
# Steps after which the search ends, whatever members gain; recordings need six.
MOST_STEPS = 12
# One statistic of some three hundred is as odd as that by chance in one of thirty thousand.
REFUTED_P = 1e-7


@dataclass(frozen=True, eq=False)
class Causes:
    """A set of causes, fitted together.

    Attributes
    ----------
    members : in the order in which they were found. fit : with all of them.
    score : ln likelihood gained, less the price of all members (nats).
    """

    members: tuple[FittedEffect, ...]
    fit: ConfiguredFit
    score: float

    @property
    def names(self) -> frozenset[str]:
        """Of the members."""
        return frozenset(one.effect.name for one in self.members)


def price(one: FittedEffect) -> float:
    """What a member of a set costs: its numbers, and how unlikely it is beforehand (nats)."""
    return one.penalty + (TERM_NATS if one.effect.form else CAUSE_NATS)


def several_causes(
    first: BeadCheck,
    begun: BeadCheck,
    effects: Sequence[Effect],
    random: np.random.Generator,
    say: Callable[[str], None],
) -> list[Named]:
    """The causes and terms that together make recording and simulation agree, in the order found;
    none where they do not, or where others weigh as much.

    Parameters
    ----------
    first : the bead's first check. begun : with what was taken off the traces in time, if anything.
    """
    without = begun.case.fit
    nothing = Causes((), without, 0.0)
    members: tuple[Effect, ...] = (*effects, *TERMS)
    weighed: dict[frozenset[str], Causes] = {}
    best, beam = nothing, [nothing]
    rivals: list[Causes] = []
    for _ in range(MOST_STEPS):
        say("weighing causes beside " + (", ".join(sorted(best.names)) or "none"))
        # the better the fit, the more of what differs is seen as what it is
        evidence = evidence_of(replace(begun, case=replace(begun.case, fit=best.fit)))
        beam = _grown(beam, without, members, evidence, weighed)
        next_best = max(beam, key=_score, default=best)
        if best.members and next_best.score < best.score + UNDISPUTED_NATS:
            # what is left is small: is it anything?
            named_instead = _with_names(best, without, members, evidence)
            if named_instead is not best:
                weighed[named_instead.names] = best = named_instead
                beam, rivals = [best], []
                continue
            say("checking with " + ", ".join(sorted(best.names)))
            try:
                check = check_bead(replace(begun.case, fit=best.fit), random)
                if check.p_value >= CLEARLY_NOT and not agrees(check, first):
                    # few simulations leave it to chance
                    check = check_bead(check.case, random, rounds=(SURE_SIMULATIONS,), begun=check)
            except (FitError, ValueError):
                return []
            if agrees(check, first):
                best, check = _better_judged(best, check, rivals, begun, random)
                others = [one for names, one in weighed.items() if names != best.names]
                return _in_order(begun, best, check, random) if leads(best, others) else []
            wrong = _contradicted(begun, best, check, random)
            if wrong:
                say(f"without {wrong}, which is not how positions are distributed")
                members = tuple(one for one in members if one.name != wrong)
                weighed = {names: one for names, one in weighed.items() if wrong not in names}
                beam = sorted([nothing, *weighed.values()], key=_score, reverse=True)[:BEAM]
                best = beam[0]
                continue
            if next_best.score - best.score < hopeful(check):
                break
        if next_best.score <= best.score:
            break
        beam = [
            _settled(one) if next_best.score - one.score < UNDISPUTED_NATS else one for one in beam
        ]
        best = max(beam, key=_score)
        rivals = [one for one in beam if one is not best and best.score - one.score < ALIKE_NATS]
    return []


def _better_judged(
    best: Causes,
    check: BeadCheck,
    rivals: Sequence[Causes],
    begun: BeadCheck,
    random: np.random.Generator,
) -> tuple[Causes, BeadCheck]:
    """Of sets that are nearly as likely, the one that likelihood and battery together speak for
    (as of single effects, `rivals.better_judged`), with its check.
    """
    for rival in rivals:
        if rival.score + ln_of(1.0) <= best.score + ln_of(check.p_value):
            continue
        try:
            other = check_bead(replace(begun.case, fit=rival.fit), random)
        except (FitError, ValueError):
            continue
        p_best, p_rival = comparable_p_values(check, other)
        if p_rival >= AGREES_P and rival.score + ln_of(p_rival) > best.score + ln_of(p_best):
            best, check = rival, other
    return best, check


def _contradicted(
    begun: BeadCheck, causes: Causes, check: BeadCheck, random: np.random.Generator
) -> str:
    """The name of a member by which positions would be distributed, or change in time, as they
    were not recorded: without it, all else as it was fitted, they would not. Empty where there is
    none.

    Of that likelihood, which is of spectra and heights, knows nothing.
    """
    odd = [
        look
        for look, p_value in zip(check.looks, check.p_values, strict=True)
        if look.statistic not in SPECTRAL and p_value < REFUTED_P
    ]
    for one in causes.members if odd else ():
        rest = [other for other in causes.members if other is not one]
        try:
            model, theta = model_with(begun.case.fit, rest, causes.fit)
            expected = model.all_expected(theta)
            value = model.log_likelihood(expected, theta)
            fewer = ConfiguredFit(model, theta, expected, value, converged=True)
            other = check_bead(replace(begun.case, fit=fewer), random, rounds=(ENOUGH,))
        except (FitError, ValueError):
            continue
        p_values = dict(zip(other.looks, other.p_values, strict=True))
        if any(p_values.get(look, 0.0) > AGREES_P for look in odd):
            return one.effect.name
    return ""


def hopeful(check: BeadCheck) -> float:
    """What a member has to gain if two more such may mend what the battery objects to (nats): none
    mends more than it gains.
    """
    return 0.5 * math.log(AGREES_P / max(check.p_value, 1e-300))


def leads(best: Causes, others: Sequence[Causes]) -> bool:
    """Whether each cause of a set has most of the weight of all sets that were weighed.

    Members that take each other's place are for `Named.alternatives` to say: a set that differs by
    one of them counts for both.
    """
    for name in (one.effect.name for one in best.members if not one.effect.form):
        without = sum(
            math.exp(min(one.score - best.score, 0.0))
            for one in others
            if name not in one.names and len(best.names - one.names) > 1
        )
        if without >= 1:
            return False
    return True


def _score(one: Causes) -> float:
    return one.score


def _grown(
    beam: Sequence[Causes],
    without: ConfiguredFit,
    members: Sequence[Effect],
    evidence: Evidence,
    weighed: dict[frozenset[str], Causes],
) -> list[Causes]:
    """The best few of the sets with one member more, less those that it makes needless.

    Parameters
    ----------
    weighed : all sets as yet; new ones are added.
    """
    grown: list[Causes] = []
    for one in beam:
        causes = [member for member in members if not member.form]
        forms = [member for member in members if member.form]
        promising = most_promising(one.fit, causes, evidence, MOST_NAMES)
        promising |= most_promising(one.fit, forms, evidence, MOST_FORMS)
        able = [member for member in members if member.name in promising]
        tried = try_effects(one.fit, able, evidence, beside=bool(one.members), only=promising)
        by_worth = sorted(tried, key=lambda other: price(other) - other.gain)
        for other in by_worth[:BEAM]:
            if other.gain <= price(other):
                break
            if gained_by_motion(other) < ALIKE_NATS:
                continue  # all of it but its motion fits as well
            larger = _needed(without, (*one.members, other), other.fit)
            if larger.names not in weighed:
                weighed[larger.names] = larger
                grown.append(larger)
    return sorted(grown, key=_score, reverse=True)[:BEAM]


def _with_names(
    best: Causes, without: ConfiguredFit, members: Sequence[Effect], evidence: Evidence
) -> Causes:
    """The set with a cause that has a name in the place of one of its terms, if that is likelier: a
    term that was taken early may stand for what is left once other causes are there.
    """
    named = [one for one in members if not one.form and one.name not in best.names]
    for one in best.members:
        if not one.effect.form:
            continue
        rest = tuple(other for other in best.members if other is not one)
        try:
            fewer = together(without, rest, best.fit)
        except (FitError, ValueError):
            continue
        promising = most_promising(fewer, named, evidence, MOST_NAMES)
        able = [other for other in named if other.name in promising]
        for other in try_effects(fewer, able, evidence, beside=bool(rest), only=promising):
            gain = other.fit.log_likelihood - without.log_likelihood
            score = gain - sum(price(each) for each in (*rest, other))
            if score > best.score and gained_by_motion(other) >= ALIKE_NATS:
                return _settled(Causes((*rest, other), other.fit, score))
    return best


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
    gain = fit.log_likelihood - without.log_likelihood
    return Causes(members, fit, gain - sum(price(one) for one in members))


def _settled(one: Causes) -> Causes:
    """The set with forces begun afresh and the formula of the chain that suits it best: what was
    chosen without any of it may be wrong with it.
    """
    try:
        fit = best_formula(begun_again(one.fit))
    except (FitError, ValueError):
        return one
    return replace(one, fit=fit, score=one.score + fit.log_likelihood - one.fit.log_likelihood)


def _in_order(
    begun: BeadCheck, causes: Causes, last: BeadCheck, random: np.random.Generator
) -> list[Named]:
    """The members with the checks before and after each, and what each gains on time that was not
    fitted; none where one gains nothing there.
    """
    case, before, named = begun.case, begun, list[Named]()
    for count, one in enumerate(causes.members, start=1):
        rest = [other for other in causes.members if other is not one]
        try:
            fewer = together(case.fit, rest, last.case.fit)
            heldout = heldout_gain(case, fewer, last.case.fit)
            if heldout <= 0:
                return []
            after = last
            if count < len(causes.members):
                there = together(case.fit, causes.members[:count], last.case.fit)
                after = check_bead(replace(case, fit=there), random, rounds=SEARCHING)
        except (FitError, ValueError):
            return []
        named.append(Named(replace(one, fit=after.case.fit), (), before, after, heldout))
        before = after
    return named
