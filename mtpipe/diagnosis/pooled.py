"""What the beads of a recording say together of a size that they share: arithmetic alone.

Each bead's ln likelihood over the size is taken as a parabola about its own best value, its forces
and its own effects following. A size that is common to all costs its penalty once. A bead may
differ from the others by a cause of its own that hides the shared one, or that looks like it; such
a cause costs numbers like any other, one where something shared is hidden, two where nothing is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

# One size for all beads, or one of its own for each: 3 nats decide.
TOLD_NATS = 3.0
# What a bead says of a size that another would have: it asks for that too, or for another, it
# excludes it, or cannot tell it from none.
ASKED, ANOTHER, EXCLUDED, UNKNOWN = ANSWERS = ("asked", "another", "excluded", "unknown")


@dataclass(frozen=True)
class Curve:
    """A bead's ln likelihood over the size of a shared effect.

    Attributes
    ----------
    value, stderr : best size for this bead, in the unit of the effect's parameter (0: none).
    nats : ln likelihood there less that of the bead as it was explained by itself, after BIC but
        for the effect's own number.
    penalty : what that number costs.
    """

    value: float
    stderr: float
    nats: float
    penalty: float

    def at(self, value: float) -> float:
        """`nats` at another size."""
        return self.nats - 0.5 * ((value - self.value) / self.stderr) ** 2

    def says(self, value: float) -> str:
        """What the bead says of a size: one of `ANSWERS`."""
        none, most = self.at(0.0), self.penalty + TOLD_NATS
        if self.nats - self.at(value) > most:
            return ANOTHER if self.nats - none > most else EXCLUDED
        if abs(self.at(value) - none) <= TOLD_NATS:
            return UNKNOWN
        return ASKED if self.at(value) > none else EXCLUDED

    @property
    def hidden(self) -> float:
        """`nats` where a cause of the bead's own hides the size that the others have."""
        return self.nats - self.penalty


@dataclass(frozen=True)
class Ballot:
    """What one bead says.

    Attributes
    ----------
    curves : of shared effects, by name.
    slots : of each effect that the bead names by itself: its name with 0, and those of its
        alternatives with their net gain less that one's. Only those in which a shared effect is.
    """

    curves: Mapping[str, Curve]
    slots: tuple[Mapping[str, float], ...]

    def without(self, effects: Sequence[str]) -> float:
        """Nats of the bead's best account without these effects, after BIC.

        Where only a shared effect explains the bead, a cause of its own that imitates it is
        assumed, at the cost of one more number.
        """
        total = 0.0
        for slot in self.slots:
            if set(slot) & set(effects):
                lookalike = -next(c.penalty for name, c in self.curves.items() if name in slot)
                total += max([n for e, n in slot.items() if e not in effects], default=lookalike)
        return total


@dataclass(frozen=True)
class Common:
    """A size that beads have in common.

    Attributes
    ----------
    value, stderr : of the size. nats : of all beads, after BIC.
    beads : that have it; in the others a cause of their own hides it.
    """

    value: float
    stderr: float
    nats: float
    beads: tuple[str, ...]


def common(curves: Mapping[str, Curve], penalty: float, *, all_of: Sequence[str] = ()) -> Common:
    """The common size under which the beads are most likely.

    Parameters
    ----------
    curves : by bead, at least one. penalty : of the common size.
    all_of : beads in which it may not be hidden.
    """
    found = [
        _climbed(curves, penalty, all_of, Common(start.value, math.nan, -math.inf, ()))
        for start in curves.values()
    ]
    return max(found, key=lambda one: one.nats)


def _climbed(
    curves: Mapping[str, Curve], penalty: float, all_of: Sequence[str], here: Common
) -> Common:
    """The best size near a first one: alternately the mean of the beads that have it, and which
    beads have that mean.
    """
    beads = tuple(b for b, c in curves.items() if b in all_of or c.at(here.value) > c.hidden)
    if beads == here.beads:
        return here
    total = sum(curves[bead].stderr ** -2 for bead in beads)
    value = sum(curves[bead].stderr ** -2 * curves[bead].value for bead in beads) / total
    nats = sum(c.at(value) if b in beads else c.hidden for b, c in curves.items()) - penalty
    # every round makes the beads more likely, so this ends
    return _climbed(curves, penalty, all_of, Common(value, total**-0.5, nats, beads))


@dataclass(frozen=True)
class Outcome:
    """What the beads together make of one effect that a bead names.

    Attributes
    ----------
    left : effects that may be named, the best first; empty where the others exclude the only one.
    others : what the others have in common of the first, where that is shared, no other is left,
        and a cause of the bead's own would be worse.
    beside : whether the bead has that too, but beside it a cause of its own.
    """

    left: tuple[str, ...]
    others: Common | None = None
    beside: bool = False


def weighed(ballots: Mapping[str, Ballot], bead: str, slot: Mapping[str, float]) -> Outcome:
    """Decide what a bead may name: each of its explanations is weighed together with the best that
    all other beads can then have.

    Parameters
    ----------
    ballots : by bead. slot : of this bead's ballot.
    """
    mine = ballots[bead]
    shared = [effect for effect in slot if effect in mine.curves]
    private = {effect: nats for effect, nats in slot.items() if effect not in shared}
    # the other beads, if none has a shared effect
    nothing = sum(one.without(shared) for name, one in ballots.items() if name != bead)
    own = max(private.values(), default=mine.without(shared)) + nothing
    totals = {effect: nats + nothing for effect, nats in private.items()}
    beside, of_others = dict[str, float](), dict[str, Common]()
    agreed = -math.inf
    for effect in shared:
        curves = {name: b.curves[effect] for name, b in ballots.items() if effect in b.curves}
        penalty = pooled_penalty([curve.penalty for curve in curves.values()])
        totals[effect] = common(curves, penalty, all_of=[bead]).nats
        agreed = max(agreed, common(curves, penalty, all_of=list(curves)).nats)
        rest = {name: curve for name, curve in curves.items() if name != bead}
        if rest:
            of_others[effect] = there = common(rest, penalty)
            beside[effect] = there.nats + max([curves[bead].hidden, *private.values()])
    first = max(shared, key=lambda effect: totals[effect])
    hidden = max(beside, key=lambda effect: beside[effect], default=first)
    top, other = totals[first], max(own, beside.get(hidden, -math.inf))
    if other > max(top, own) + TOLD_NATS:
        return Outcome((hidden,), of_others[hidden], beside=True)
    if other > top + TOLD_NATS:
        totals = {effect: totals[effect] for effect in private}
    best = max(totals.values(), default=0.0)
    left = sorted((e for e in totals if totals[e] > best - TOLD_NATS), key=lambda e: -totals[e])
    supported = top > other + TOLD_NATS
    refuted = agreed < max(top, other) - TOLD_NATS
    if refuted and not supported and not set(left) & set(private):
        return Outcome(())
    return Outcome(tuple(left), of_others.get(first) if supported and len(left) == 1 else None)


def also_in(ballots: Mapping[str, Ballot], bead: str, effect: str) -> Outcome | None:
    """A shared effect that others have, in a bead that did without it; None where it is hidden."""
    curves = {name: b.curves[effect] for name, b in ballots.items() if effect in b.curves}
    penalty = pooled_penalty([curve.penalty for curve in curves.values()])
    mine = curves.pop(bead, None)
    if mine is None or not curves or any(effect in slot for slot in ballots[bead].slots):
        return None
    others = common(curves, penalty)
    return Outcome((effect,), others, beside=True) if mine.at(others.value) > mine.hidden else None


def pooled_penalty(penalties: Sequence[float]) -> float:
    """What a number costs that is fitted to several beads' ordinates: half of ln of all of them.

    Parameters
    ----------
    penalties : half of ln of each bead's.
    """
    return 0.5 * math.log(sum(math.exp(2 * one) for one in penalties))
