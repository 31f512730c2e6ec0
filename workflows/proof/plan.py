"""What each recording of a set conceals, and how strongly.

Recordings come in blocks of twenty-five: four clean, two with nothing but a laboratory's usual
errors in the setup, ten with one effect of the catalogue, three with two, three with three or four,
three with an effect outside it. Effects and strengths of single ones go round, so that every
combination is there equally often. It depends on the set's seed and the recording's number alone.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import concealed
import numpy as np
import outside

BLOCK = (
    ("clean",) * 4
    + ("usual errors",) * 2
    + ("single",) * 10
    + ("pair",) * 3
    + ("several",) * 3
    + ("outside",) * 3
)
NOTHING_CONCEALED = ("clean", "usual errors")
# Nats beyond the penalty of each strength; the last ends where nobody asks further.
STRENGTHS = {"faint": (10.0, 25.0), "moderate": (25.0, 100.0), "clear": (100.0, 600.0)}
PAIR_STRENGTHS = ("moderate", "clear")
SEVERAL = (3, 4)


@dataclass(frozen=True)
class Task:
    """What a recording is to conceal."""

    kind: str
    names: tuple[str, ...] = ()
    strength: str | None = None


def task(seed: int, number: int) -> Task:
    """What recording `number` of a seed's set conceals."""
    block, place = divmod(number, len(BLOCK))
    order = np.random.default_rng([seed, block, 1]).permutation(len(BLOCK))
    kind = BLOCK[order[place]]
    # how many of its kind came before
    turn = block * BLOCK.count(kind) + int(sum(BLOCK[i] == kind for i in order[:place]))
    if kind in NOTHING_CONCEALED:
        return Task(kind)
    if kind == "outside":
        names = sorted(outside.EFFECTS)
        return Task(kind, (names[_shuffled(seed, 2, turn, len(names))],))
    if kind == "single":
        every = list(itertools.product(sorted(concealed.BY_NAME), STRENGTHS))
        name, size = every[_shuffled(seed, 3, turn, len(every))]
        return Task(kind, (name,), size)
    strength = PAIR_STRENGTHS[turn % len(PAIR_STRENGTHS)]
    if kind == "several":
        return Task(kind, _several(np.random.default_rng([seed, turn, 5])), strength)
    pairs = [
        (a.name, b.name)
        for a, b in itertools.combinations(concealed.EFFECTS, 2)
        if a.kind != b.kind
    ]
    pair = pairs[_shuffled(seed, 4, turn, len(pairs))]
    return Task(kind, pair, strength)


def _several(random: np.random.Generator) -> tuple[str, ...]:
    """Three or four effects, of kinds of their own."""
    number = int(random.choice(SEVERAL))
    kinds = random.permutation(sorted({effect.kind for effect in concealed.EFFECTS}))[:number]
    return tuple(
        str(random.choice([effect.name for effect in concealed.EFFECTS if effect.kind == kind]))
        for kind in kinds
    )


def strength_of(nats: float) -> str:
    """The name of a strength, from nats beyond the penalty."""
    for name, (_, most) in STRENGTHS.items():
        if nats < most:
            return name if nats >= STRENGTHS["faint"][0] else "too faint"
    return "clear"


def _shuffled(seed: int, what: int, turn: int, number: int) -> int:
    """Number `turn` of an endless series in which each of `number` comes once per round."""
    round_, place = divmod(turn, number)
    return int(np.random.default_rng([seed, round_, what]).permutation(number)[place])
