"""Why a recording is not what its configured experiment would have given.

Causes are weighed as sets first (`mtpipe.diagnosis.sets`). Where no set explains the recording,
effects are fitted one at a time to all traces together; the one that gains most is kept if it earns
its parameters, and the search goes on from there until none does. Each effect kept is then asked
again whether the others could do without it. Effects that the recording cannot tell from the one
named are listed beside it (`mtpipe.diagnosis.alternatives`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mtpipe.crosschecking.check import (
    CLEARLY_CONSISTENT,
    CLEARLY_NOT,
    ENOUGH,
    ROUNDS,
    BeadCheck,
    check_bead,
    comparable_p_values,
)
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.diagnosis.alternatives import among_tried, with_alternatives
from mtpipe.diagnosis.bent_scale import Instead, bend_instead
from mtpipe.diagnosis.evidence import evidence_of
from mtpipe.diagnosis.explanation import (
    AGREES_P,
    ALARM_P,
    ALIKE_NATS,
    Explanation,
    Named,
    agrees,
)
from mtpipe.diagnosis.heights import gained_by_scatter, wanders
from mtpipe.diagnosis.kept import (
    MOST_CANDIDATES,
    SURE_SIMULATIONS,
    gains_in_words,
    heights_off,
    named_effect,
    not_enough,
    too_little,
)
from mtpipe.diagnosis.refit import begun_again, best_formula, with_forces_found
from mtpipe.diagnosis.rivals import better_judged, ln_of
from mtpipe.diagnosis.sets import several_causes
from mtpipe.diagnosis.superfluous import (
    KEPT_NATS,
    SEEN_NATS,
    certain,
    without_superfluous,
    without_unclear_third,
)
from mtpipe.diagnosis.time_corrections import corrected, late_corrections
from mtpipe.diagnosis.unexplained import Rejected
from mtpipe.effects.catalogue import catalogue
from mtpipe.effects.effect import Effect
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import (
    FittedEffect,
    looking_ahead,
    try_effects,
)

# Where the battery is clearly content with an effect, a second one has to gain so much: the form of
# the first is known only so well, and what is left of it may look like another.
BESIDE_NATS = 10.0
MOST_EFFECTS = 3
# Few simulations say that recording and simulation will not agree where p is that far below.
RULED_OUT = 1e-4 * AGREES_P
Say = Callable[[str], None]


def explain(
    before: BeadCheck,
    random: np.random.Generator,
    *,
    effects: Sequence[Effect] | None = None,
    progress: Say | None = None,
) -> Explanation:
    """Look for the cause of what differs from the simulation.

    Parameters
    ----------
    before : the bead's cross-check. effects : default: the whole catalogue.
    """
    say = progress or (lambda step: None)
    effects = catalogue() if effects is None else effects
    say("looking for sticking and pixel locking")
    corrections, begun = corrected(before, random)
    together = _by_sets(before, corrections, begun, effects, random, say)
    return together or _by_search(before, corrections, begun, effects, random, say)


def _by_sets(
    before: BeadCheck,
    corrections: Sequence[Named],
    begun: BeadCheck,
    effects: Sequence[Effect],
    random: np.random.Generator,
    say: Say,
) -> Explanation | None:
    """What a set of causes explains; None where none does, or none is needed."""
    if agrees(begun, before):
        return None
    causes = several_causes(before, begun, effects, random, say)
    if not causes:
        return None
    case, named = begun.case, [*corrections, *causes]
    verdict, kept, check, _ = concluded(before, case.fit, named, named[-1].after, None, random)
    if verdict == "unexplained":
        return None
    if any(one.form for one in kept):
        verdict = "described"
    told_apart = tuple(with_alternatives(one, kept, case, effects) for one in kept)
    return Explanation(before, check, told_apart, verdict, None)


def _by_search(
    before: BeadCheck,
    corrections: Sequence[Named],
    begun: BeadCheck,
    effects: Sequence[Effect],
    random: np.random.Generator,
    say: Say,
) -> Explanation:
    """What is found one after the other."""
    named, check, nearest, case = _searched_twice(before, corrections, begun, effects, random, say)
    found_first = len(named)
    named, check = without_superfluous(case, named, check, random)
    named, check, nearest = without_unclear_third(named, check, nearest)
    named, check = made_sure(before, named, check, random)
    verdict, kept, check, nearest = concluded(before, case.fit, named, check, nearest, random)
    # the last was compared with all others there, unless one of them has gone since
    compared = kept[-1:] if len(named) == found_first else []
    told_apart = tuple(
        one if one in compared else with_alternatives(one, kept, case, effects) for one in kept
    )
    return Explanation(before, check, told_apart, verdict, nearest)


def _searched_twice(
    before: BeadCheck,
    corrections: Sequence[Named],
    begun: BeadCheck,
    effects: Sequence[Effect],
    random: np.random.Generator,
    say: Say,
) -> tuple[list[Named], BeadCheck, Rejected | None, PreparedBead]:
    """As `_searched`, once more with the corrections that are seen only beside what was found; and
    the bead without any effect of the spectrum.
    """
    case = begun.case
    named, check, nearest = _searched(begun, corrections, effects, random, say)
    if len(corrections) < len(named):
        # what is seen in time has a test of its own, and effects of the spectrum may have hidden it
        say("looking for sticking and pixel locking again")
        late = late_corrections(check, corrections, case, random)
        again = (
            _searched(late[-1].after, [*corrections, *late], effects, random, say) if late else None
        )
        if again is not None and agrees(again[1], before):
            case = late[-1].after.case
            named, check, nearest = again
    return named, check, nearest, case


def made_sure(
    before: BeadCheck, named: list[Named], check: BeadCheck, random: np.random.Generator
) -> tuple[list[Named], BeadCheck]:
    """What was found and the check with it, from more simulations where few leave it to chance
    whether something is left.
    """
    if not named:
        return named, check
    check = clearer(check, random)
    if check.p_value >= CLEARLY_NOT and not agrees(check, before):
        check = check_bead(check.case, random, rounds=(SURE_SIMULATIONS,), begun=check)
    return [*named[:-1], replace(named[-1], after=check)], check


def clearer(check: BeadCheck, random: np.random.Generator) -> BeadCheck:
    """A check of the search, beside more simulations where those of the search leave it open."""
    if len(check.simulated) > ENOUGH or not CLEARLY_NOT <= check.p_value <= CLEARLY_CONSISTENT:
        return check
    return check_bead(check.case, random, rounds=(ENOUGH, ROUNDS[-1]), begun=check)


def concluded(
    before: BeadCheck,
    without: ConfiguredFit,
    named: list[Named],
    check: BeadCheck,
    nearest: Rejected | None,
    random: np.random.Generator,
) -> tuple[str, list[Named], BeadCheck, Rejected | None]:
    """The verdict, the effects that may be named with it, the check with these, and what came
    nearest where something is left.

    Parameters
    ----------
    before : the bead's first check. without : fit without any effect of the spectrum.
    named : in the order found. check : with all of them. nearest : what the search did not take at
    its end.
    """
    fitted = [one.found for one in named if isinstance(one.found, FittedEffect)]
    scatter = gained_by_scatter(check.case.fit, fitted) if fitted else 0.0
    off = scatter >= ALIKE_NATS
    agreed, kept = agrees(check, before), certain(named)
    bent = preferred_bend(without, fitted, check, random) if agreed or kept else None
    if named and agreed and not off and bent is None:
        return "explained", named, check, None
    if off:
        kept = list(itertools.takewhile(lambda one: not _frees_heights(one), kept))
    if bent is not None:
        kept = list(itertools.takewhile(lambda one: one.found not in bent.replaced, kept))
    left_out = next(iter(named[len(kept) :]), None)
    if left_out is not None and isinstance(left_out.found, FittedEffect):
        rival = bent.bend if bent is not None and left_out.found in bent.replaced else None
        if off and _frees_heights(left_out):
            reason = heights_off(left_out, scatter)
        elif rival is not None:
            reason = f"{gains_in_words(left_out.found)}, but is no likelier than {rival.words}"
        else:
            reason = not_enough(left_out)
        nearest = Rejected(left_out.found, reason, instead=rival)
    if not kept:
        verdict = "consistent" if before.p_value >= ALARM_P else "unexplained"
        return verdict, kept, before, nearest if verdict == "unexplained" else None
    if len(kept) < len(named):
        kept = [*kept[:-1], replace(kept[-1], after=clearer(kept[-1].after, random))]
    return "unexplained", kept, kept[-1].after, nearest


def preferred_bend(
    without: ConfiguredFit,
    named: Sequence[FittedEffect],
    check: BeadCheck,
    random: np.random.Generator,
) -> Instead | None:
    """A bend of z's scale that likelihood and battery together speak for, and not for the effects
    in whose place it is; None where there is none.

    They are compared as rivals of the catalogue are (`better_judged`).

    Parameters
    ----------
    without : fit without any of the effects. check : with all of them.
    """
    found = bend_instead(without, named, check.case.fit)
    if found is None or found.lead < -ALIKE_NATS:
        return None
    lead = found.lead
    if lead < ALIKE_NATS and check.p_value < CLEARLY_CONSISTENT:
        try:
            with_it = check_bead(replace(check.case, fit=found.bend.fit), random)
        except (FitError, ValueError):
            return None
        p_effects, p_bend = comparable_p_values(check, with_it)
        lead += ln_of(p_bend) - ln_of(p_effects)
    return found if lead > 0 else None


def _frees_heights(one: Named) -> bool:
    """Whether it is with this effect that heights are free to wander."""
    return wanders(one.after.case.fit) and not wanders(one.before.case.fit)


def _searched(
    check: BeadCheck,
    corrections: Sequence[Named],
    effects: Sequence[Effect],
    random: np.random.Generator,
    say: Say,
) -> tuple[list[Named], BeadCheck, Rejected | None]:
    """Effects found one after the other, the corrections before them, and the check with them; the
    one that was not taken at the end.
    """
    nearest: Rejected | None
    case, fit = check.case, check.case.fit
    named, nearest = list(corrections), None
    while len(named) < MOST_EFFECTS:
        say("trying effects")
        beside = len(named) > len(corrections)
        tried = try_effects(fit, effects, evidence_of(check), beside=beside)
        needed = KEPT_NATS if check.p_value < ALARM_P else SEEN_NATS
        if named and check.p_value >= CLEARLY_CONSISTENT:
            needed = BESIDE_NATS
        if not tried or tried[0].net < needed:
            nearest = Rejected(tried[0], too_little(tried[0], needed)) if tried else None
            break
        able = [one for one in tried if one.net >= needed]
        if not beside and len(able) > 1:
            say("trying pairs of effects")
            able = looking_ahead(fit, able)
        rejected: list[Rejected] = []
        candidates = able[:MOST_CANDIDATES]
        while candidates:
            one = candidates.pop(0)
            say(f"checking with {one.effect.name}")
            found = named_effect(_refitted(one, check), check, case, random)
            if isinstance(found, Named):
                break
            rejected.append(found)
            if found.unseen:
                # what fits better but cannot be told leaves no room for what fits worse
                candidates = [c for c in candidates if one.net - c.net < ALIKE_NATS]
        if isinstance(found, Rejected):
            nearest = max(rejected, key=lambda one: one.tried.net)
            break
        # those before it have been rejected
        rivals = [c for c in able[able.index(one) + 1 :] if one.net - c.net < ALIKE_NATS]
        found = better_judged(
            found,
            rivals,
            partial(_refitted, check=check),
            partial(named_effect, check=check, case=case, random=random, far_off=RULED_OUT),
        )
        named.append(among_tried(found, tried, {found.name}, case, fit))
        check, fit = found.after, found.after.case.fit
    return named, check, nearest


def _refitted(chosen: FittedEffect, check: BeadCheck) -> FittedEffect:
    """The effect with forces begun afresh and the formula of the chain that suits it best."""
    fit = best_formula(begun_again(with_forces_found(chosen, check).fit))
    return replace(chosen, fit=fit, gain=fit.log_likelihood - check.case.fit.log_likelihood)
