"""Beads as the columns of a file: their names, and their entries in `[source] beads`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mtpipe.proposal.look import Column
from mtpipe.proposal.name_words import is_reference

NUMBER = re.compile(r"\d+")
PLACE = "{n}"
# Words that are good names of beads with a number; a group or a program's name is none.
BEAD = re.compile(r"beads?|kugel|perle|bille|particle|tether|ref\w*|[bmrp]")


@dataclass(frozen=True, eq=False)
class Bead:
    """A bead's columns by axis, and its name."""

    name: str
    axes: dict[str, Column]


@dataclass(frozen=True, eq=False)
class Found:
    """Beads that were found; `entries` as `[source] beads` has them, `how` in words."""

    beads: tuple[Bead, ...]
    entries: list[dict[str, Any]]
    how: str


def names_of(owners: list[tuple[str, ...]]) -> list[str]:
    """Short names of beads: the words that tell them apart."""
    if len(owners) > 1:
        common = set.intersection(*(set(o) for o in owners))
        if any(all(part in common or not part.isdigit() for part in o) for o in owners):
            # a number that does not tell them apart is one of each: b1 and ref1
            common = {word for word in common if not word.isdigit()}
        short = [tuple(word for word in o if word not in common) for o in owners]
        # one word of all beads stays if only numbers are left of their names: bead1, bead2
        last = [next((w for w in reversed(o) if BEAD.fullmatch(w)), "b") for o in owners]
        names = [
            "".join((w, *s)) if all(part.isdigit() for part in s) else "".join(s)
            for w, s in zip(last, short, strict=True)
        ]
        if len(set(names)) == len(names):
            return names
        return ["".join(o) or "b" for o in owners]
    word = "".join(owners[0])
    numbered = any(part.isdigit() for part in owners[0]) and not word.isdigit()
    return [word if is_reference(word) or numbered else "b1"]


def entry_of(bead: Bead) -> dict[str, Any]:
    """The entry of one bead."""
    return {"name": bead.name, **{axis: bead.axes[axis].told for axis in sorted(bead.axes)}}


def patterns(beads: Sequence[Bead]) -> list[dict[str, Any]]:
    """Entries of beads, one for all whose names differ in a number alone."""
    entries: list[dict[str, Any]] = []
    by_pattern: dict[tuple[str, ...], list[Bead]] = {}
    for bead in beads:
        by_pattern.setdefault(_pattern_of(bead), []).append(bead)
    for pattern, members in by_pattern.items():
        if len(members) > 1 and pattern and pattern[0]:
            axes = sorted(members[0].axes)
            entries.append({"name": pattern[0], **dict(zip(axes, pattern[1:], strict=True))})
        else:
            entries += [entry_of(bead) for bead in members]
    return entries


def _pattern_of(bead: Bead) -> tuple[str, ...]:
    """Names of the bead and its columns, with `{n}` for its number; () if they have no common."""
    number = NUMBER.findall(bead.name)
    if len(number) != 1:
        return ()
    texts = [bead.name, *(str(bead.axes[axis].told) for axis in sorted(bead.axes))]
    found = []
    for text in texts:
        places = [m for m in NUMBER.finditer(text) if m[0] == number[0]]
        if len(places) != 1:
            return ()
        found.append(text[: places[0].start()] + PLACE + text[places[0].end() :])
    return tuple(found)
