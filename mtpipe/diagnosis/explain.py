"""Why a recording is not what its configured experiment would have given.

What is seen in time and not in spectra is taken off the traces first. Causes of the rest are
weighed as sets (`mtpipe.diagnosis.sets`). Effects that the recording cannot tell from one that is
named are listed beside it (`mtpipe.diagnosis.alternatives`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mtpipe.crosschecking.check import (
    CLEARLY_CONSISTENT,
    BeadCheck,
    check_bead,
    comparable_p_values,
)
from mtpipe.diagnosis.bent_scale import Instead, bend_instead
from mtpipe.diagnosis.causes import Causes
from mtpipe.diagnosis.corrections.catalogue import CORRECTIONS, Find
from mtpipe.diagnosis.corrections.correction import Correction
from mtpipe.diagnosis.excerpt import in_all_plateaus
from mtpipe.diagnosis.explanation import ALARM_P, ALIKE_NATS, Explanation, Named, agrees, ln_of
from mtpipe.diagnosis.heights import gained_by_scatter, wanders
from mtpipe.diagnosis.naming import Weighed
from mtpipe.diagnosis.probability import odds_against_correction
from mtpipe.diagnosis.sets import several_causes
from mtpipe.diagnosis.time_corrections import corrected, hold_by_themselves, late_corrections
from mtpipe.diagnosis.unexplained import Rejected
from mtpipe.diagnosis.why_not import gains_in_words, heights_off
from mtpipe.effects.catalogue import catalogue
from mtpipe.effects.effect import Effect
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import FittedEffect


def explain(
    before: BeadCheck,
    random: np.random.Generator,
    *,
    effects: Sequence[Effect] | None = None,
    progress: Callable[[str], None] | None = None,
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
    tried: list[Weighed] = []

    def without_late(
        check: BeadCheck, best: Causes | None = None, finds: Sequence[Find] = ()
    ) -> Weighed | None:
        # what is seen in time has a test of its own, and effects of the spectrum may have hidden it
        if tried and not finds:
            return None
        say("looking for what is seen in time beside causes")
        late = late_corrections(check, corrections, begun, random, finds, curves=not tried)
        if not late:
            return None
        anew = several_causes(before, late[-1].after, effects, random, say, known=best)
        tried.append(replace(anew, corrections=tuple(late)))
        return tried[-1] if anew.named or agrees(late[-1].after, before) else None

    found = several_causes(before, begun, effects, random, say, without_late)
    if not found.named and not found.unfinished and not agrees(found.check, before):
        found = without_late(found.check, finds=CORRECTIONS) or found
        by_themselves = [one for one in tried if hold_by_themselves(one.corrections)]
        if not found.named and not found.corrections and by_themselves:
            found = by_themselves[0]
    verdict, named, after, nearest = concluded(before, begun, corrections, found, random)
    return Explanation(before, after, tuple(named), verdict, nearest)


def explain_by_excerpt(
    before: BeadCheck,
    part: BeadCheck,
    random: np.random.Generator,
    *,
    progress: Callable[[str], None] | None = None,
) -> Explanation:
    """As `explain`, looking for causes in an excerpt of the plateaus (`excerpt`).

    Parameters
    ----------
    before : the bead's cross-check. part : that of the excerpt.
    """
    say = progress or (lambda step: None)
    corrections, begun = corrected(before, random)
    found = explain(part, random, progress=progress)
    everywhere = in_all_plateaus(found, before, begun, corrections, random, say)
    verdict, named, after, nearest = concluded(before, begun, corrections, everywhere, random)
    return Explanation(before, after, tuple(named), verdict, nearest)


def concluded(
    before: BeadCheck,
    begun: BeadCheck,
    corrections: Sequence[Named],
    found: Weighed,
    random: np.random.Generator,
) -> tuple[str, list[Named], BeadCheck, Rejected | None]:
    """The verdict, what may be named with it, the check with that, and what came nearest where
    something is left.

    Parameters
    ----------
    before : the bead's first check. begun : with the corrections. found : by weighing.
    """
    if found.corrections:
        corrections, begun = [*corrections, *found.corrections], found.corrections[-1].after
    causes, nearest, off = found.named, found.nearest, False
    if causes:
        causes, nearest, off = _held_by_heights(begun.case.fit, causes, random)
        if off and causes and not agrees(causes[-1].after, before):
            # a set is named as a whole or not at all
            causes = []
    # what else could have been seen in time is not known; how likely it is by chance is
    by_chance = [
        replace(one, odds_against=odds_against_correction(one.found, one.before))
        for one in corrections
        if isinstance(one.found, Correction)
    ]
    named = [*by_chance, *causes]
    after = named[-1].after if named else before
    if off:
        left = bool(named) or before.p_value < ALARM_P
        return ("unexplained" if left else "consistent"), named, after, nearest if left else None
    if not agrees(after, before):
        return "unexplained", named, after, nearest
    if not named:
        return "consistent", named, after, None
    verdict = "described" if any(one.form for one in named) else "explained"
    return verdict, named, after, None


def _held_by_heights(
    without: ConfiguredFit, causes: list[Named], random: np.random.Generator
) -> tuple[list[Named], Rejected | None, bool]:
    """Causes up to the first that mean heights speak against, and why they do: it frees them to
    wander further than positions are seen to, or z's scale with a bend does as well; and whether
    they speak against any, or against all as they are.

    Parameters
    ----------
    without : fit without any of them.
    """
    after = causes[-1].after
    fitted = [one.found for one in causes if isinstance(one.found, FittedEffect)]
    scatter = gained_by_scatter(after.case.fit, fitted)
    bent = preferred_bend(without, fitted, after, random)
    replaced = () if bent is None else bent.replaced
    kept = list(
        itertools.takewhile(
            lambda one: (
                not (scatter >= ALIKE_NATS and _frees_heights(one)) and one.found not in replaced
            ),
            causes,
        )
    )
    off = scatter >= ALIKE_NATS or bool(replaced)
    left_out = next(iter(causes[len(kept) :]), None)
    if left_out is None or not isinstance(left_out.found, FittedEffect):
        return kept, None, off
    if bent is not None and left_out.found in replaced:
        words = f"{gains_in_words(left_out.found)}, but is no likelier than {bent.bend.words}"
        return kept, Rejected(left_out.found, words, instead=bent.bend), off
    return kept, Rejected(left_out.found, heights_off(left_out, scatter)), off


def preferred_bend(
    without: ConfiguredFit,
    named: Sequence[FittedEffect],
    check: BeadCheck,
    random: np.random.Generator,
) -> Instead | None:
    """A bend of z's scale that likelihood and battery together speak for, and not for the effects
    in whose place it is; None where there is none.

    Likelihood and battery together decide, as among sets (`judging.better_judged`).

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
