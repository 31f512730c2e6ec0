"""Which column of a file is what: by its name, else by its values.

The answer is in the words of `[source]`: beads as entries of its `beads`, columns by name or by
number. What was decided by values and not by names is a guess, and says so.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mtpipe.ground.errors import RecordingError
from mtpipe.proposal.look import Column, Look
from mtpipe.proposal.nature import Nature, nature_of
from mtpipe.proposal.words import is_reference, said_by

ARRAY = re.compile(r"(?P<base>.*)\[(?P<index>\d+(?:,\d+)*)\]")
HERTZ = re.compile(r"\b[kM]?Hz\b")
# In a table with a row for each bead in each frame, frames repeat and beads are few.
REPEATING_SHARE, MOST_BEADS_SHARE = 0.4, 0.1
OF_BEAD = re.compile(r"bead|particle|kugel|track|^id$|label", re.IGNORECASE)
NUMBER = re.compile(r"\d+")
PLACE = "{n}"
# Another number of columns per bead than three has to be so much better.
CLEARLY, TINY = 0.5, 1e-30
# Words that are good names of beads with a number; a group or a program's name is none.
BEAD = re.compile(r"beads?|kugel|perle|bille|particle|tether|ref\w*|[bmrp]")


@dataclass(frozen=True, eq=False)
class Bead:
    """A bead's columns by axis, and its name."""

    name: str
    axes: dict[str, Column]


@dataclass(frozen=True, eq=False)
class Columns:
    """The columns of a file by what they are; None for what it does not have.

    `entries` are the beads as `[source] beads` has them, `beads` the same one by one; `how` says
    in words by what they were found, `unused` which columns mean nothing here.
    """

    beads: tuple[Bead, ...] = ()
    entries: list[dict[str, Any]] = field(default_factory=list)
    how: str = ""
    time: Column | None = None
    frame: Column | None = None
    magnet: Column | None = None
    rotation: Column | None = None
    unused: tuple[Column, ...] = ()

    def of_axis(self, axis: str) -> list[Column]:
        """Columns of an axis, of all beads."""
        return [bead.axes[axis] for bead in self.beads if axis in bead.axes]


def columns_of(look: Look) -> Columns:
    """Decide which column of a file is what.

    Raises
    ------
    RecordingError : there are no positions of beads in it.
    """
    group = max(look.groups, key=_count_of_axes)
    spectrum = [c.name for c in group if HERTZ.search(c.name) and np.all(np.diff(c.seconds) > 0)]
    if spectrum:
        raise RecordingError(
            f"is a spectrum (column {spectrum[0]}), and no positions in time", where=str(look.path)
        )
    said = {id(column): said_by(column.name) for column in group}
    if look.table.has_names and _is_long(group):
        raise RecordingError(
            "has a row for each bead in each frame, and a recording needs one row for each frame",
            where=str(look.path),
            mend="Turn it round first: in pandas, table.pivot(index=frame, columns=bead).",
        )
    natures = {id(column): nature_of(column.seconds) for column in group}
    roles = {
        role: _of_role(group, role, lambda c: said[id(c)].role, natures)
        for role in ("time", "frame", "magnet", "rotation")
    }
    if roles["time"] is not None and roles["frame"] is None:
        stamp = roles["time"]
        if natures[id(stamp)] == "count" and not stamp.stated.unit:
            roles["time"], roles["frame"] = None, stamp  # numbers of frames, whatever their name
    taken = {id(column) for column in roles.values() if column is not None}
    free = [c for c in group if id(c) not in taken]
    named = [c for c in free if said[id(c)].axis is not None]
    if look.kind == "gr":  # one bead's height, which its program plots as y
        (height,) = (c for c in named if c.name == "y")
        found = _Found((Bead("b1", {"z": height}),), [{"name": "b1", "z": "y"}], "PicoTwist's plot")
    elif named and (pair := _array_alone(named)) is None:
        found = _by_names(named, look)
    else:
        others = [c for c in free if said[id(c)].role is None] if not named else pair
        assert others is not None
        found = _by_values(others, natures, roles)
    if not found.beads:
        names = ", ".join(c.name or "(empty)" for c in group[:12])
        raise RecordingError(
            "has no columns that move as beads do",
            where=str(look.path),
            mend=f"There are: {names}{', ...' if len(group) > 12 else ''}. Say which are the "
            "beads' in [source] beads (docs/source-table.md).",
        )
    if roles["time"] is not None and roles["frame"] is not None and _skips_nothing(roles["frame"]):
        roles["frame"] = None  # it counts rows; the stamps tell more
    used = {id(c) for bead in found.beads for c in bead.axes.values()}
    used |= {id(column) for column in roles.values() if column is not None}
    return Columns(
        beads=found.beads,
        entries=found.entries,
        how=found.how,
        unused=tuple(c for c in group if id(c) not in used),
        **roles,
    )


def _is_long(group: Sequence[Column]) -> bool:
    """Whether frames stand in several rows each, with a number of the bead beside them."""
    frames = [c.seconds for c in group if said_by(c.name).role in ("frame", "time")]
    ids = [c.seconds for c in group if OF_BEAD.search(c.name)]
    if not frames or not ids:
        return False
    known = ids[0][np.isfinite(ids[0])]
    steps = np.diff(frames[0])
    if not np.all(known == np.rint(known)) or len(np.unique(known)) > len(known) * MOST_BEADS_SHARE:
        return False
    frame_by_frame = float(np.mean(steps == 0)) > REPEATING_SHARE
    bead_by_bead = bool(np.any(steps < 0) and np.all(np.diff(known) >= 0))
    return frame_by_frame or bead_by_bead


def _skips_nothing(frame: Column) -> bool:
    return bool(np.all(np.diff(frame.seconds) == 1))


@dataclass(frozen=True, eq=False)
class _Found:
    beads: tuple[Bead, ...]
    entries: list[dict[str, Any]]
    how: str


def _count_of_axes(group: Sequence[Column]) -> tuple[int, int]:
    return sum(said_by(c.name).axis is not None for c in group), len(group)


def _of_role(
    group: Sequence[Column],
    role: str,
    said: Callable[[Column], str | None],
    natures: dict[int, Nature],
) -> Column | None:
    """The first column whose name says this role, if its values do not speak against it."""
    fitting: dict[str, tuple[Nature, ...]] = {
        "time": ("clock", "count"),
        "frame": ("count", "clock"),
        "magnet": ("constant", "motor", "motion", "clock"),
        "rotation": ("constant", "dead", "motor", "motion", "clock"),
    }
    for column in group:
        if said(column) == role and natures[id(column)] in fitting[role]:
            return column
    return None


def _array_alone(named: Sequence[Column]) -> list[Column] | None:
    """The columns of one array `x` of two or three columns: the axes of one bead."""
    matches = [ARRAY.fullmatch(c.name) for c in named]
    bases = {match["base"] for match in matches if match is not None}
    if None in matches or len(bases) != 1 or len(named) not in (2, 3):
        return None
    return list(named) if len({said_by(c.name).axis for c in named}) == 1 else None


def _by_names(named: Sequence[Column], look: Look) -> _Found:
    """Beads whose columns are named by axis."""
    owners: dict[tuple[str, ...], dict[str, Column]] = {}
    for column in named:
        said = said_by(column.name)
        assert said.axis is not None
        # names that repeat, as below a line with the beads' names, are of one bead after another
        times = itertools.count()
        owner = next(
            key
            for k in times
            if said.axis not in owners.get(key := (*said.owner, *([str(k)] if k else [])), {})
        )
        owners.setdefault(owner, {})[said.axis] = column
    together: dict[str, Column] = {}
    for axes in owners.values():
        together |= axes
    if len(owners) > 1 and len(together) == sum(map(len, owners.values())):
        owners = {(): together}  # `X; lateral` beside `Y`: of each axis there is one
    most = max(map(len, owners.values()))
    # what has an axis in its name and less axes than all others is no bead
    owners = {owner: axes for owner, axes in owners.items() if len(axes) == most}
    names = _names_of(list(owners))
    beads = tuple(Bead(n, axes) for n, axes in zip(names, owners.values(), strict=True))
    if not look.table.has_names:
        return _Found(beads, [_entry(bead) for bead in beads], "the names of the columns")
    return _Found(beads, _patterns(beads), "the names of the columns")


def _names_of(owners: list[tuple[str, ...]]) -> list[str]:
    """Short names of beads: the words that tell them apart."""
    if len(owners) > 1:
        common = set.intersection(*(set(o) for o in owners)) if owners else set()
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


def _entry(bead: Bead) -> dict[str, Any]:
    return {"name": bead.name, **{axis: bead.axes[axis].told for axis in sorted(bead.axes)}}


def _patterns(beads: Sequence[Bead]) -> list[dict[str, Any]]:
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
            entries += [_entry(bead) for bead in members]
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


def _by_values(
    columns: Sequence[Column], natures: dict[int, Nature], roles: dict[str, Column | None]
) -> _Found:
    """Beads among columns whose names say nothing of axes; completes the roles."""
    bases: dict[str, list[Column]] = {}
    for column in columns:
        match = ARRAY.fullmatch(column.name)
        bases.setdefault(match["base"] if match else "", []).append(column)
    if not bases:
        return _Found((), [], "")
    base, members = max(bases.items(), key=lambda one: len(one[1]))
    indices = [match["index"] for c in members if (match := ARRAY.fullmatch(c.name))]
    if indices and "," in indices[0]:
        return _of_three_axes(base, members)
    for column in columns:
        if column not in members and natures[id(column)] == "count" and roles["frame"] is None:
            roles["frame"] = column
    before: list[Column] = []
    rest = list(members)
    for column in members:
        nature = natures[id(column)]
        if nature in ("clock", "count"):
            role = "time" if nature == "clock" else "frame"
            if roles[role] is None:
                roles[role] = column
            rest.remove(column)
    # motors stand before the beads, and so does what never had a value
    while rest and natures[id(rest[0])] != "motion":
        before.append(rest.pop(0))
    if not rest:
        return _Found((), [], "")
    width, extra = _width(rest)
    before += rest[:extra]
    rest = rest[extra:]
    motors = [c for c in before if natures[id(c)] != "dead"]
    if motors and roles["magnet"] is None:
        roles["magnet"] = motors.pop(0)
    if motors and roles["rotation"] is None:
        roles["rotation"] = motors.pop(0)
    order = "xyz"[: min(width, 3)]
    names = [f"b{k + 1}" for k in range(len(rest) // width)]
    beads = tuple(
        Bead(name, dict(zip(order, rest[k * width :], strict=False)))
        for k, name in enumerate(names)
    )
    how = f"the values of the columns, taken for {', '.join(order)} of each bead in turn"
    if len(beads) == 1:
        return _Found(beads, [_entry(beads[0])], how)
    entry = {"first_column": rest[0].told, "order": order.ljust(width, "_"), "names": names}
    return _Found(beads, [entry], how)


def _width(columns: Sequence[Column]) -> tuple[int, int]:
    """Columns per bead, and how many columns before the first bead are none of its."""
    n = len(columns)
    if n <= 3:
        return max(n, 1), 0
    mixed = {w: _mixed(columns, w) for w in (3, 2, 4, 5) if n % w == 0 and n > w}
    if not mixed:
        return 3, n % 3
    best = min(mixed, key=lambda width: mixed[width])
    clearly = 3 not in mixed or mixed[best] < CLEARLY * mixed[3]
    return (best if clearly else 3), 0


def _mixed(columns: Sequence[Column], width: int) -> float:
    """How unlike the places of one axis are among beads, over those of all columns.

    Small for the right width: x, y and z are each on a scale of their own. 1 for places that
    count from each bead's own.
    """
    place = np.array([np.nanmedian(np.abs(c.seconds)) for c in columns])
    spread = np.array([np.nanstd(c.seconds) for c in columns])
    if np.median(place) < 3 * np.median(spread):
        return 1.0
    logs = np.log(place + TINY)
    within = np.mean([np.var(logs[k::width]) for k in range(width)])
    return float(within / max(np.var(logs), TINY))


def _of_three_axes(base: str, members: Sequence[Column]) -> _Found:
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
        return _Found(beads, [{"name": f"b{PLACE}", **columns}], how)
    passed = "_" * (axes - len(order))
    entry = {"first_column": f"{base}[1,1]", "order": order + passed, "names": names}
    return _Found(beads, [entry], how)


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
