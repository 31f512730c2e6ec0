"""The second round: beads recorded together share camera, optics and buffer.

Every bead has been explained by itself. Where one names, or cannot exclude, an effect whose size is
shared (`Effect.shared`), all beads are asked what size they would have it: a bead that names it by
its fit, one of which it is an alternative by the alternative's, any other by fitting it beside what
was found. `mtpipe.diagnosis.pooled` weighs the answers. Beads that are unexplained have no say and
stay as they are: their errors are not known. A size that several beads have in common is then told
to each by the others, as a prior, and what has changed is checked again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from concurrent.futures import Executor, Future
from typing import TypeVar

from mtpipe.crosschecking.beads import DATA_ERRORS, bead_generator
from mtpipe.diagnosis.explanation import Explanation
from mtpipe.diagnosis.pooled import (
    ANOTHER,
    ANSWERS,
    ASKED,
    EXCLUDED,
    UNKNOWN,
    Ballot,
    Curve,
    also_in,
    weighed,
)
from mtpipe.diagnosis.revision import Change, accounts, coordinate, with_changes
from mtpipe.effects.effect import Effect, Evidence
from mtpipe.ground.steps import Steps
from mtpipe.ground.types import Progress
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import FittedEffect, best_of

T = TypeVar("T")
WORDS = {
    ASKED: ("has it too", "have it too"),
    ANOTHER: ("has another size", "have another size"),
    EXCLUDED: ("excludes it", "exclude it"),
    UNKNOWN: ("cannot tell", "cannot tell"),
}


def beads_together(
    found: Mapping[str, Explanation],
    pool: Executor,
    *,
    seed: int,
    progress: Progress | None = None,
) -> Steps[dict[str, Explanation]]:
    """Explanations that heed what the beads share, in steps.

    Parameters
    ----------
    found : by bead, each by itself. seed : of the simulations.
    progress : called with (steps done, of how many) where there is anything to do.
    """
    voters = {bead: one for bead, one in found.items() if one.verdict != "unexplained"}
    wanted = {
        tried.effect.name: tried.effect
        for one in voters.values()
        for named in one.named
        for tried, _ in accounts(named)
        if tried.shared
    }
    if len(voters) < 2 or not wanted:
        return dict(found)
    say = progress or (lambda done, total: None)
    say(0, len(voters))

    def counted(future: Future[T], done: itertools.count[int], total: int) -> Future[T]:
        future.add_done_callback(lambda _: say(next(done), total))
        return future

    done = itertools.count(1)
    asked = {
        bead: counted(pool.submit(_beside, one.fit, _not_yet(one, wanted)), done, len(voters))
        for bead, one in voters.items()
    }
    yield list(asked.values())
    ballots = {
        bead: _ballot(one, _result(asked[bead], otherwise={})) for bead, one in voters.items()
    }
    changes = _changes(voters, wanted, ballots)
    changed = [bead for bead in voters if changes[bead]]
    again = {}
    for bead in changed:
        random = bead_generator(seed, f"{bead} together")
        future = pool.submit(with_changes, voters[bead], changes[bead], random)
        again[bead] = counted(future, done, len(voters) + len(changed))
    yield list(again.values())
    return {
        bead: _result(again[bead], otherwise=one) if bead in again else one
        for bead, one in found.items()
    }


def _result(future: Future[T], *, otherwise: T) -> T:
    """What was found, or what there was: a bead that fails takes nothing from the others."""
    try:
        return future.result()
    except DATA_ERRORS:
        return otherwise


def _not_yet(one: Explanation, wanted: Mapping[str, Effect]) -> list[Effect]:
    """Shared effects of which this bead has not said what size it would have them."""
    said = {tried.effect.name for named in one.named for tried, _ in accounts(named)}
    return [effect for name, effect in wanted.items() if name not in said]


def _beside(fit: ConfiguredFit, effects: list[Effect]) -> Mapping[str, Curve]:
    """Shared effects fitted beside what a bead has, as far as they can be."""
    curves = {}
    for effect in effects:
        tried = best_of(fit, effect, Evidence((), tuple(float(f) for f in fit.force_pN)))
        curve = None if tried is None else _curve(tried, tried.fit, tried.net)
        if curve is not None:
            curves[effect.name] = curve
    return curves


def _curve(tried: FittedEffect, fit: ConfiguredFit, net: float) -> Curve | None:
    """ln likelihood over an effect's size; `net`: at its best, after BIC. None: not one size."""
    if len(tried.hypothesis.parameters) != 1:
        return None
    k = coordinate(fit, tried)
    variance = float(fit.covariance[k, k])
    if not (variance > 0 and math.isfinite(variance)):
        return None
    return Curve(float(fit.theta[k]), math.sqrt(variance), net + tried.penalty, tried.penalty)


def _ballot(one: Explanation, beside: Mapping[str, Curve]) -> Ballot:
    """What a bead says of all shared effects."""
    curves, slots = dict(beside), []
    for named in one.named:
        slot: dict[str, float] = {}
        for tried, net in accounts(named):
            name = tried.effect.name
            slot[name] = net
            fit = one.fit if tried is named.found else tried.fit
            curve = _curve(tried, fit, net) if tried.shared else None
            if curve is not None and (name not in curves or curves[name].nats < curve.nats):
                curves[name] = curve
        if set(slot) & set(curves):
            slots.append(slot)
    return Ballot(curves, tuple(slots))


def _changes(
    voters: Mapping[str, Explanation],
    wanted: Mapping[str, Effect],
    ballots: Mapping[str, Ballot],
) -> dict[str, list[Change]]:
    """What the beads together make of what each names."""
    changes: dict[str, list[Change]] = {bead: [] for bead in voters}
    established = set()
    for bead, one in voters.items():
        slots = iter(ballots[bead].slots)
        for place, named in enumerate(one.named):
            names = [tried.effect.name for tried, _ in accounts(named)]
            shared = [name for name in names if name in ballots[bead].curves]
            if not shared:
                continue
            found = weighed(ballots, bead, next(slots))
            if found.others is not None or set(found.left) != set(names):
                name = next((name for name in found.left if name in shared), shared[0])
                told = _told(name, bead, ballots)
                changes[bead].append(Change(place, found, wanted[name], told))
            if found.others is not None:
                established.add(found.left[0])
    for name in sorted(established):
        for bead, one in voters.items():
            first = next((i for i, named in enumerate(one.named) if accounts(named)), None)
            also = also_in(ballots, bead, name)
            if first is not None and also is not None:
                told = _told(name, bead, ballots)
                changes[bead].append(Change(first, also, wanted[name], told))
    return changes


def _told(effect: str, bead: str, ballots: Mapping[str, Ballot]) -> str:
    """Sentence on how many other beads have a shared effect of the size that this bead has."""
    size = ballots[bead].curves[effect].value
    said = [
        ballot.curves[effect].says(size)
        for name, ballot in ballots.items()
        if name != bead and effect in ballot.curves
    ]
    counts = {answer: said.count(answer) for answer in ANSWERS if answer in said}
    parts = [f"{count} {WORDS[answer][count > 1]}" for answer, count in counts.items()]
    return f"of {len(said)} other bead{'s' if len(said) > 1 else ''} {', '.join(parts)}"
