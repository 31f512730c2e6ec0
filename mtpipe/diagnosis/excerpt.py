"""Causes looked for in some of a bead's plateaus, and tried in all of them.

The search takes time in proportion to the number of plateaus. Eight that span the forces, as many
as a usual staircase has, show a missing effect as well as dozens do; what was found is verified in
all plateaus at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mtpipe.crosschecking.check import BeadCheck
from mtpipe.diagnosis.alternatives import SEEN_NATS
from mtpipe.diagnosis.causes import Causes, begun_afresh, causes_of
from mtpipe.diagnosis.corrections.catalogue import CORRECTIONS
from mtpipe.diagnosis.corrections.correction import Correction
from mtpipe.diagnosis.evidence import evidence_of
from mtpipe.diagnosis.explanation import Alternative, Explanation, Named, agrees
from mtpipe.diagnosis.judging import checked_with, rejected
from mtpipe.diagnosis.naming import Weighed, in_order_found
from mtpipe.diagnosis.time_corrections import hold_by_themselves, late_corrections
from mtpipe.diagnosis.unexplained import Rejected
from mtpipe.effects.effect import Effect
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.hypotheses import FittedEffect, together, try_effects
from mtpipe.joint_fit.score_test import most_promising
from mtpipe.recording.recording import Recording, States

# Plateaus in which causes are looked for: as many as a usual staircase has.
MOST_PLATEAUS = 8


def excerpt(recording: Recording, check: BeadCheck) -> Recording | None:
    """The recording with the other plateaus refused than those in which a bead's causes are looked
    for: of each of equal ranges of ln force the longest, then the longest of all. None where it has
    no more than that.
    """
    plateaus = check.case.plateaus
    if len(plateaus) <= MOST_PLATEAUS:
        return None
    ln_force = np.log(check.case.fit.force_pN)
    share = (ln_force - ln_force.min()) / max(np.ptp(ln_force), 1e-12)
    place = np.minimum((share * MOST_PLATEAUS).astype(int), MOST_PLATEAUS - 1)
    frames = np.array([one.frames for one in check.case.fit.model.data])
    longest_first = np.argsort(-frames, kind="stable")
    of_each = [int(longest_first[place[longest_first] == k][0]) for k in np.unique(place)]
    rest = [int(i) for i in longest_first if i not in of_each]
    chosen = {*[*of_each, *rest][:MOST_PLATEAUS]}
    others = [one.number for i, one in enumerate(plateaus) if i not in chosen]
    states = recording.states if recording.states is not None else States()
    left_out = {(check.case.bead, number): "not in the excerpt" for number in others}
    return replace(recording, states=replace(states, refused={**states.refused, **left_out}))


def in_all_plateaus(
    found: Explanation,
    first: BeadCheck,
    begun: BeadCheck,
    corrections: Sequence[Named],
    random: np.random.Generator,
    say: Callable[[str], None],
) -> Weighed:
    """What was found in an excerpt, tried in all plateaus: named if recording and simulation agree
    with it there.

    How sure its names are is taken from the excerpt.

    Parameters
    ----------
    found : in the excerpt. first : the bead's first check. begun : with corrections, which were
        taken off the traces in time; both of all plateaus.
    """
    causes = [one for one in found.named if isinstance(one.found, FittedEffect)]
    taken = {one.name for one in corrections}
    late = [one for one in found.named if isinstance(one.found, Correction)]
    seen = any(one.name not in taken for one in late)
    if not causes and not seen:
        return Weighed([], begun, _nearest_there(found.nearest, begun))
    say("fitting to all plateaus " + ", ".join(one.name for one in causes))
    best = _fitted(causes, begun)
    if best is None:
        return Weighed([], begun)
    say("checking all plateaus")
    besides: list[Named] = []
    try:
        check = checked_with(best, begun, first, random)
        if seen and not agrees(check, first):
            # what the excerpt showed only beside its causes
            besides = late_corrections(check, corrections, begun, random, CORRECTIONS)
        if besides:
            begun = besides[-1].after
            best = _fitted(causes, begun) or best
            check = checked_with(best, begun, first, random)
        if not agrees(check, first):
            why = (
                f"recording and simulation differ in all plateaus together (p {check.p_value:.1g})"
            )
            certain = tuple(besides) if hold_by_themselves(besides) else ()
            return Weighed([], check, rejected(best, why), certain)
        named = in_order_found(begun, best, check, random)
    except (FitError, ValueError) as error:
        return Weighed([], begun, rejected(best, f"the bead cannot be simulated ({error})"))
    if causes and not named:
        return Weighed([], check, rejected(best, "nothing in data kept out of the fit"))
    told = [
        replace(
            one,
            alternatives=_alternatives(one, there, best, begun),
            odds_against=there.odds_against,
        )
        for one, there in zip(named, causes, strict=True)
    ]
    return Weighed(told, check, corrections=tuple(besides))


def _fitted(causes: Sequence[Named], begun: BeadCheck) -> Causes | None:
    """The causes fitted to all plateaus, each beside those before it; None where one cannot be."""
    without = begun.case.fit
    best = Causes((), without, 0.0)
    for one in causes:
        assert isinstance(one.found, FittedEffect)
        fitted = _one_fitted(one.found.effect, best, begun)
        if fitted is None:
            return None
        best = causes_of((*best.members, fitted), fitted.fit, without)
    return begun_afresh(best)


def _one_fitted(effect: Effect, beside: Causes, begun: BeadCheck) -> FittedEffect | None:
    """An effect with the best of its hypotheses; None where none applies or can be fitted."""
    evidence = evidence_of(replace(begun, case=replace(begun.case, fit=beside.fit)))
    promising = most_promising(beside.fit, [effect], evidence, 1)
    if not promising:
        return None
    tried = try_effects(beside.fit, [effect], evidence, beside=bool(beside.members), only=promising)
    return tried[0] if tried else None


def _alternatives(
    one: Named, there: Named, best: Causes, begun: BeadCheck
) -> tuple[Alternative, ...]:
    """The alternatives that a cause had in the excerpt, fitted in its place to all plateaus."""
    others = [other for other in best.members if other.effect.name != one.name]
    found = []
    for other in there.alternatives:
        try:
            rest = together(begun.case.fit, others, best.fit)
        except (FitError, ValueError):
            return ()
        fitted = _one_fitted(other.found.effect, Causes(tuple(others), rest, 0.0), begun)
        if fitted is not None and fitted.net >= SEEN_NATS:
            found.append(Alternative(fitted, other.nats))
    return tuple(found)


def _nearest_there(nearest: Rejected | None, begun: BeadCheck) -> Rejected | None:
    """The cause that came nearest in the excerpt, fitted to all plateaus."""
    if nearest is None:
        return None
    fitted = _one_fitted(nearest.tried.effect, Causes((), begun.case.fit, 0.0), begun)
    if fitted is None:
        return None
    plateaus = len(begun.case.plateaus)
    looked = f"in {MOST_PLATEAUS} of {plateaus} plateaus, in which causes were looked for"
    return Rejected(fitted, f"{nearest.reason} ({looked})")
