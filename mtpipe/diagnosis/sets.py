"""Causes weighed as sets, by what they explain together.

A real recording has four or five causes. Each by itself explains little, and with one of them alone
recording and simulation may differ even more, so a set of causes is weighed as a whole
(`mtpipe.diagnosis.causes`). Sets grow by one member at a time, the two best of each size. At the
end the set is compared with simulations: if recording and simulation do not agree with all of it,
none of it is named. What is named of a set that agrees `mtpipe.diagnosis.naming` says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.crosschecking.check import BeadCheck
from mtpipe.diagnosis.causes import (
    BEAM,
    Causes,
    begun_afresh,
    by_score,
    causes_of,
    exchanged,
    grown,
    likelier_by_exchange,
    likeliest_left,
    objected,
    price,
)
from mtpipe.diagnosis.evidence import evidence_of
from mtpipe.diagnosis.explanation import ALIKE_NATS, agrees, ln_of
from mtpipe.diagnosis.judging import (
    better_judged,
    checked_with,
    contradicted,
    hopeful,
    judged,
    lacked_by,
    rejected,
)
from mtpipe.diagnosis.naming import (
    FORM_NATS,
    Weighed,
    last_named,
    named_of,
    of_fitted_time_only,
)
from mtpipe.diagnosis.single_events import unseen_member
from mtpipe.diagnosis.unexplained import Rejected
from mtpipe.diagnosis.why_not import gains_in_words, too_little
from mtpipe.effects.effect import Effect
from mtpipe.effects.terms.catalogue import TERMS
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import FittedEffect, together

# A set whose next member gains 20 nats or more is not complete, and is not simulated yet.
UNDISPUTED_NATS = 20.0
# Most steps of the search, and most members of a set; real recordings have up to ten.
MOST_STEPS, MOST_MEMBERS = 12, 12
# Sets that may be refused before nothing is named, each judged better than those before: one costs
# as much as a step of the search.
MOST_REFUSED = 4


def _nothing_else(check: BeadCheck, best: Causes) -> Weighed | None:
    return None


def several_causes(
    first: BeadCheck,
    begun: BeadCheck,
    effects: Sequence[Effect],
    random: np.random.Generator,
    say: Callable[[str], None],
    instead: Callable[[BeadCheck, Causes], Weighed | None] = _nothing_else,
    known: Causes | None = None,
) -> Weighed:
    """Weigh causes as sets.

    Parameters
    ----------
    first : the bead's first check. begun : with what was taken off the traces in time, if anything.
    instead : what is found in another way, if anything, where simulations object to a set: asked
        before a cause is blamed for what may not be its own.
    known : a set that was likeliest before something more was taken off the traces: followed
        beside nothing.
    """
    without = begun.case.fit
    nothing = Causes((), without, 0.0)
    members: tuple[Effect, ...] = (*effects, *TERMS)
    beam = [nothing, *_again(known, without)]
    best, check = beam[-1], begun
    weighed = {one.names: one for one in beam[1:]}
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
                wrong = of_fitted_time_only(begun, best, check)
                if wrong and (
                    other := likelier_by_exchange(best, without, members, evidence, weighed)
                ):
                    # what is amiss may be the company
                    best, beam, rivals = other, [other], []
                    continue
            if not wrong and agrees(check, first):
                agreed.append((best, check))
                if gained < FORM_NATS + ln_of(check.p_value) - ln_of(1.0):
                    agreed[-1] = better_judged(best, check, rivals, begun, random)[:2]
                    break
            if not (wrong or agreed) and (other_way := instead(check, best)) is not None:
                return other_way
            wrong = wrong or contradicted(begun, best, check, random)
            if wrong:
                say(f"without {wrong}, which the traces contradict")
                members = tuple(one for one in members if one.name != wrong)
                weighed = {names: one for names, one in weighed.items() if wrong not in names}
                rest = tuple(one for one in best.members if one.effect.name != wrong)
                weighed |= {one.names: one for one in _again(replace(best, members=rest), without)}
                beam = sorted([nothing, *weighed.values()], key=by_score, reverse=True)[:BEAM]
                best = beam[0]
                continue
            if gained < hopeful(check):
                why = f"recording and simulation differ (p {check.p_value:.1g})"
                best = weighed[best.names] = judged(best, check)
                say("looking for what it lacks")
                larger = lacked_by(best, check, without, members, evidence, weighed)
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
        if gained <= 0 or len(next_best.members) > MOST_MEMBERS:
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
        nearest = _nearest(first_tried, best, without)
        return Weighed([], check, nearest, unfinished=gained > 0)
    against = [one.causes for one in refused]
    able = [one for one in members if not one.form]

    def told(best: Causes, check: BeadCheck) -> Weighed:
        others = [objected(one, against) for names, one in weighed.items() if names != best.names]
        return named_of(best, others, begun, check, first, random, able)

    return last_named(agreed, told)


def _again(known: Causes | None, without: ConfiguredFit) -> list[Causes]:
    """The set, fitted again, as to other traces or with fewer members; nothing where there is none
    or it cannot be.
    """
    if known is None or not known.members:
        return []
    try:
        return [causes_of(known.members, together(without, known.members, known.fit), without)]
    except (FitError, ValueError):
        return []


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
    fit = begun_afresh(causes_of((strongest,), strongest.fit, without)).fit
    gain = fit.log_likelihood - without.log_likelihood
    strongest = replace(strongest, fit=fit, gain=gain)
    if strongest.gain <= price(strongest):
        return Rejected(strongest, too_little(strongest, price(strongest)))
    instead = ", ".join(sorted(best.names))
    return Rejected(
        strongest, f"{gains_in_words(strongest)}, less than forms without a name ({instead})"
    )
