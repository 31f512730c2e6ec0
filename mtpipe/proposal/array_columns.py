"""Beads in arrays: of frames × beads × axes, or of frames × axes for each bead, z perhaps apart."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from mtpipe.proposal.bead_columns import PLACE, Bead, Found, names_of, patterns
from mtpipe.proposal.look import Column
from mtpipe.proposal.name_words import owner_of
from mtpipe.proposal.nature import Nature

ARRAY = re.compile(r"(?P<base>.*)\[(?P<index>\d+(?:,\d+)*)\]")
NO_PLACE: set[Nature] = {"clock", "count", "constant", "dead"}


def of_many_arrays(
    bases: Mapping[str, Sequence[Column]], natures: Mapping[int, Nature]
) -> Found | None:
    """Beads that have an array each, as `roi/07/pos`; None where there are not several such."""
    arrays = {
        base: members
        for base, members in bases.items()
        if base and len(members) in (2, 3) and not NO_PLACE & {natures[id(c)] for c in members}
    }
    if len(arrays) < 2 or len({len(members) for members in arrays.values()}) > 1:
        return None
    order = "xyz"[: len(next(iter(arrays.values())))]
    names = names_of([owner_of(base) for base in arrays])
    beads = tuple(
        Bead(name, dict(zip(order, members, strict=True)))
        for name, members in zip(names, arrays.values(), strict=True)
    )
    return Found(beads, patterns(beads), f"arrays, one for each bead, taken for {', '.join(order)}")


def with_lateral_arrays(
    beads: Sequence[Bead], free: Sequence[Column], natures: Mapping[int, Nature]
) -> tuple[Bead, ...]:
    """Beads that have a column for z, and x and y in an array of frames × 2 in the same group.

    Beads stay as they are if not each of them has one such array.
    """
    arrays: dict[str, dict[str, list[Column]]] = {}
    for column in free:
        match = ARRAY.fullmatch(column.name)
        if match and natures[id(column)] not in NO_PLACE:
            home = match["base"].rpartition("/")[0]
            arrays.setdefault(home, {}).setdefault(match["base"], []).append(column)
    found = []
    for bead in beads:
        home = next(iter(bead.axes.values())).name.rpartition("/")[0]
        pairs = [members for members in arrays.get(home, {}).values() if len(members) == 2]
        if set(bead.axes) != {"z"} or len(pairs) != 1:
            return tuple(beads)
        found.append(Bead(bead.name, {**dict(zip("xy", pairs[0], strict=True)), **bead.axes}))
    return tuple(found)


def of_three_axes(base: str, members: Sequence[Column]) -> Found:
    """Beads of an array of frames × beads × axes, or frames × axes × beads."""
    pairs = {
        tuple(map(int, match["index"].split(","))): c
        for c in members
        if (match := ARRAY.fullmatch(c.name))
    }
    first, second = (max(pair[k] for pair in pairs) for k in (0, 1))
    beads_first = second in (2, 3) or first not in (2, 3)
    if first in (2, 3) and second in (2, 3) and first == second:
        beads_first = _height_apart(pairs, second, 1) <= _height_apart(pairs, first, 0)
    count, axes = (first, second) if beads_first else (second, first)
    order = "xyz"[: min(axes, 3)]
    names = [f"b{k + 1}" for k in range(count)]
    beads = tuple(
        Bead(
            name,
            {
                axis: pairs[(k + 1, a + 1) if beads_first else (a + 1, k + 1)]
                for a, axis in enumerate(order)
            },
        )
        for k, name in enumerate(names)
    )
    told = "beads × axes" if beads_first else "axes × beads"
    how = f"the shape of {base}, {told} in each frame"
    if not beads_first:
        columns = {axis: f"{base}[{a + 1},{PLACE}]" for a, axis in enumerate(order)}
        return Found(beads, [{"name": f"b{PLACE}", **columns}], how)
    passed = "_" * (axes - len(order))
    entry = {"first_column": f"{base}[1,1]", "order": order + passed, "names": names}
    return Found(beads, [entry], how)


def _height_apart(pairs: dict[tuple[int, ...], Column], axes: int, axis: int) -> float:
    """How far the last axis's places are apart, over those of the others: small for heights.

    Parameters
    ----------
    axis : which of the two numbers of a column counts the axes.
    """
    spans = []
    for k in range(1, axes + 1):
        places = [np.nanmedian(c.seconds) for pair, c in pairs.items() if pair[axis] == k]
        spans.append(float(np.ptp(places)))
    return spans[-1] / max(min(spans[:-1]), 1e-300)
