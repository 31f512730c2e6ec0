"""Marks of diagnoses against answers: pure functions of plain data.

A name is right when it is what is concealed, or lists that among its equivalents. An effect counts
as identified when the verdict is `explained` and exactly the concealed effects are named.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

EXACT, PARTIAL, WRONG = "exact", "partial", "wrong"
LOCATED, MISSED, FAILED = "located", "missed", "failed"
RIGHT, ALARM = "right", "false alarm"
SAME_MAGNET_MM = 0.006


@dataclass(frozen=True)
class Force:
    """One plateau: relative errors before and after, error after over its standard error, and the
    bias that is expected without the effect (nan: not known).
    """

    before: float
    after: float
    pull: float
    bias: float


@dataclass(frozen=True)
class Score:
    """One recording.

    Attributes
    ----------
    kind, strength, chain, effects : of the answer. verdict, named : of the diagnosis.
    outcome : of recordings that conceal nothing "right" or "false alarm"; of effects outside the
        catalogue "right" (unexplained or described without a name, at the right place), "located"
        (the same, elsewhere), "wrong" (explained, with a name) or "missed"; of others "exact",
        "partial" (nothing wrong, but not all, or something unexplained), "wrong" (any wrong name),
        "located" or "missed".
    wrong : names that are not right. left : effects without a name.
    by_equivalent : some name is right by its equivalents. equivalents : how many are listed in all.
    bound : share of a force by which what is unexplained may move it, as stated.
    place : whether the most significant place is right; None where nothing defines it.
    sure : of each name its probability, and whether it is right or has a right equivalent; names
        of recordings that were made before there was a probability are not among them.
    """

    kind: str
    strength: str
    chain: str
    effects: tuple[str, ...]
    verdict: str
    named: tuple[str, ...]
    outcome: str
    wrong: tuple[str, ...]
    by_equivalent: bool
    equivalents: int
    bound: float
    place: bool | None
    forces: tuple[Force, ...]
    seconds: float
    sure: tuple[tuple[float, bool], ...] = ()
    left: tuple[str, ...] = ()


def score(answer: dict[str, Any], outcome: dict[str, Any]) -> Score:
    """Mark one diagnosis.

    Parameters
    ----------
    answer : as `generate.make` has it. outcome : as `blind.diagnosed` has it.
    """
    effects = tuple(one["effect"] for one in answer["effects"])
    # one that stretches is one of the two as well
    chain = "marko-siggia" if answer["formula"].endswith("marko-siggia") else "bouchiat"
    bead = outcome["bead"]
    if bead is None:
        return Score(
            answer["kind"], answer["strength"] or "", chain, effects, "", (), FAILED, (), False, 0,
            math.nan, None, (), outcome["seconds"], (), effects,
        )  # fmt: skip
    named = bead["effects"]
    wrong, left, by_equivalent = _matched(named, effects)
    place = place_is_right(answer["effects"], bead)
    if answer["kind"] in ("clean", "usual errors"):
        marked = RIGHT if bead["verdict"] == "consistent" and not named else ALARM
    elif answer["kind"] == "outside":
        wrong = [one["effect"] for one in named]
        marked = _outside(bead["verdict"], bool(named), place)
    else:
        marked = _inside(bead["verdict"], wrong, left, effects)
    return Score(
        kind=answer["kind"],
        strength=answer["strength"] or "",
        chain=chain,
        effects=effects,
        verdict=bead["verdict"],
        named=tuple(one["effect"] for one in named),
        outcome=marked,
        wrong=tuple(wrong),
        by_equivalent=by_equivalent,
        equivalents=sum(len(one["equivalent"]) for one in named),
        bound=bead["force_bound_percent"] / 100,
        place=place,
        forces=_forces(answer, bead),
        seconds=outcome["seconds"],
        left=tuple(left),
        sure=tuple(
            (one["probability"], one["effect"] not in wrong)
            for one in named
            if "probability" in one
        ),
    )


def _matched(
    named: Sequence[dict[str, Any]], effects: Sequence[str]
) -> tuple[list[str], list[str], bool]:
    """Wrong names, effects without a name, and whether an equivalent was needed."""
    left = list(effects)
    others = []
    for one in named:
        if one["effect"] in left:
            left.remove(one["effect"])
        else:
            others.append(one)
    wrong, by_equivalent = [], False
    for one in others:
        alike = [name for name in one["equivalent"] if name in left]
        if alike:
            left.remove(alike[0])
            by_equivalent = True
        else:
            wrong.append(one["effect"])
    return wrong, left, by_equivalent


def _inside(verdict: str, wrong: Sequence[str], left: Sequence[str], effects: Sequence[str]) -> str:
    if wrong:
        return WRONG
    if not left:
        return EXACT if verdict == "explained" else PARTIAL
    if len(left) < len(effects):
        return PARTIAL
    return MISSED if verdict == "consistent" else LOCATED


def _outside(verdict: str, named: bool, place: bool | None) -> str:
    if verdict == "unexplained" or (verdict == "described" and not named):
        return LOCATED if place is False else RIGHT
    return WRONG if named else MISSED


def place_is_right(effects: Sequence[dict[str, Any]], bead: dict[str, Any]) -> bool | None:
    """Whether the most significant place agrees with one of the effects in all that defines it.

    What the place leaves open (a band where it is no matter of frequency) is not held against it.
    """
    defined = [one["where"] for one in effects if "where" in one]
    if not defined:
        return None
    if not bead["located"]:
        return False
    top = min(bead["located"], key=lambda one: one["p_value"])
    return any(_agrees(top, where) for where in defined)


def _agrees(place: dict[str, Any], where: dict[str, Any]) -> bool:
    # two axes together are the place of something in one of them, and all axes of anything
    if where["axes"] and not set(_axes(place["axis"])) & {
        axis for name in where["axes"] for axis in _axes(name)
    }:
        return False
    plateaus = place["plateaus"]
    if where["plateaus"] is not None and plateaus:
        inside = [number in where["plateaus"] for number in plateaus]
        if np.mean(inside) < 0.5:
            return False
    if where["band_hz"] is not None and place["band_hz"] is not None:
        low, high = place["band_hz"]
        return bool(low <= where["band_hz"][1] and high >= where["band_hz"][0])
    return True


def _axes(name: str) -> str:
    return name or "xyz"


def _forces(answer: dict[str, Any], bead: dict[str, Any]) -> tuple[Force, ...]:
    biases = answer["force_bias"] or [math.nan] * len(answer["plateaus"])
    found = []
    for row in bead["forces"]:
        for plateau, bias in zip(answer["plateaus"], biases, strict=True):
            if abs(plateau["magnet_mm"] - row["magnet_mm"]) < SAME_MAGNET_MM and _complete(row):
                true = plateau["force_pN"]
                found.append(
                    Force(
                        row["force_before_pN"] / true - 1,
                        row["force_pN"] / true - 1,
                        (row["force_pN"] - true) / row["stderr_pN"],
                        bias,
                    )
                )
                break
    return tuple(found)


def _complete(row: dict[str, Any]) -> bool:
    return all(row[key] for key in ("force_pN", "stderr_pN", "force_before_pN"))


def wilson(hits: int, total: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927); nan of nothing."""
    if total == 0:
        return math.nan, math.nan
    p = hits / total
    middle = (p + z**2 / (2 * total)) / (1 + z**2 / total)
    half = z / (1 + z**2 / total) * math.sqrt(p * (1 - p) / total + z**2 / (4 * total**2))
    return max(0.0, middle - half), min(1.0, middle + half)
