"""Several causes at once, where one after the other explains nothing.

A real recording has four or five. Each by itself explains little, and with one of them alone
recording and simulation may differ even more, so here likelihood alone decides which are taken:
one more as long as it gains, and none that the others make needless. The battery speaks at the end:
if recording and simulation do not agree with all of them, none is named. Nor is any where a search
that begins with another effect ends with other causes that agree as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mtpipe.crosschecking.check import BeadCheck, check_bead
from mtpipe.diagnosis.evidence import evidence_of
from mtpipe.diagnosis.explanation import ALIKE_NATS, Named, agrees
from mtpipe.diagnosis.heldout import heldout_gain
from mtpipe.diagnosis.kept import SEARCHING
from mtpipe.effects.effect import Effect
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import FittedEffect, looking_ahead, together, try_effects

# What an effect gains beyond this (nats) is taken before recording and simulation are compared.
UNDISPUTED_NATS = 20.0
# More causes than any recording was seen to have: the search ends, whatever they gain.
MOST_CAUSES = 9


def several_causes(
    first: BeadCheck,
    begun: BeadCheck,
    effects: Sequence[Effect],
    random: np.random.Generator,
    say: Callable[[str], None],
) -> list[Named]:
    """The causes that together make recording and simulation agree, in the order found; none where
    they do not, or where others do so too.

    Parameters
    ----------
    first : the bead's first check. begun : with what was taken off the traces in time, if anything.
    """
    say("trying several causes at once")
    found = _agreeing(first, begun, effects, random, say)
    if found is None:
        return []
    named = _in_order(begun, *found, random)
    if named:
        say("beginning with another effect")
        other = _agreeing(first, begun, effects, random, say, beside=found[0][0])
        if other is not None and _names(other[0]) != _names(found[0]):
            return []
    return named


def _agreeing(
    first: BeadCheck,
    begun: BeadCheck,
    effects: Sequence[Effect],
    random: np.random.Generator,
    say: Callable[[str], None],
    beside: FittedEffect | None = None,
) -> tuple[list[FittedEffect], BeadCheck] | None:
    """As few effects as recording and simulation agree with, by likelihood, forward and back; None
    where there are fewer than two.

    Parameters
    ----------
    beside : an effect with which the search does not begin.
    """
    evidence, without = evidence_of(begun), begun.case.fit
    chosen: list[FittedEffect] = []
    fit = without
    while len(chosen) < MOST_CAUSES:
        tried = try_effects(fit, effects, evidence, beside=bool(chosen))
        able = [one for one in tried if one.net >= ALIKE_NATS]
        if len(chosen) > 1 and (not able or able[0].net < UNDISPUTED_NATS):
            # what is left is small: is it anything?
            say("checking with " + ", ".join(one.effect.name for one in chosen))
            try:
                check = check_bead(replace(begun.case, fit=fit), random)
            except (FitError, ValueError):
                return None
            if agrees(check, first):
                return chosen, check
        if not able:
            break
        if not chosen:
            able = looking_ahead(fit, able)
            able = [one for one in able if beside is None or one.effect != beside.effect]
            if not able:
                break
        now, with_it = _needed(without, [*chosen, able[0]], able[0].fit)
        if _names(now) == _names(chosen):
            break
        chosen, fit = now, with_it
    return None


def _names(chosen: Sequence[FittedEffect]) -> set[str]:
    return {one.effect.name for one in chosen}


def _needed(
    without: ConfiguredFit, chosen: Sequence[FittedEffect], fit: ConfiguredFit
) -> tuple[list[FittedEffect], ConfiguredFit]:
    """Those of the effects without which the others lose more than they cost."""
    kept = list(chosen)
    for one in chosen[:-1]:
        rest = [other for other in kept if other is not one]
        try:
            fewer = together(without, rest, fit)
        except (FitError, ValueError):
            continue
        if fit.log_likelihood - fewer.log_likelihood - one.penalty < ALIKE_NATS:
            kept, fit = rest, fewer
    return kept, fit


def _in_order(
    begun: BeadCheck,
    chosen: Sequence[FittedEffect],
    last: BeadCheck,
    random: np.random.Generator,
) -> list[Named]:
    """The effects with the checks before and after each, and what each gains on time that was not
    fitted; none where one gains nothing there.
    """
    case, before, named = begun.case, begun, list[Named]()
    for count, one in enumerate(chosen, start=1):
        rest = [other for other in chosen if other is not one]
        try:
            fewer = together(case.fit, rest, last.case.fit)
            heldout = heldout_gain(case, fewer, last.case.fit)
            if heldout <= 0:
                return []
            after = last
            if count < len(chosen):
                there = together(case.fit, chosen[:count], last.case.fit)
                after = check_bead(replace(case, fit=there), random, rounds=SEARCHING)
        except (FitError, ValueError):
            return []
        named.append(Named(replace(one, fit=after.case.fit), (), before, after, heldout))
        before = after
    return named
