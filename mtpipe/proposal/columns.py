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
from mtpipe.proposal.array_columns import (
    ARRAY,
    of_many_arrays,
    of_three_axes,
    with_lateral_arrays,
)
from mtpipe.proposal.bead_columns import Bead, Found, entry_of, names_of, patterns
from mtpipe.proposal.look import Column, Look
from mtpipe.proposal.name_words import Said, said_by
from mtpipe.proposal.nature import Nature, nature_of
from mtpipe.proposal.units import stated_unit
from mtpipe.setup.source_parts import SECONDS_PER_UNIT

HERTZ = re.compile(r"\b[kM]?Hz\b")
# In a table with a row for each bead in each frame, frames repeat and beads are few.
REPEATING_SHARE, MOST_BEADS_SHARE = 0.4, 0.1
OF_BEAD = re.compile(r"bead|particle|kugel|track|^id$|label", re.IGNORECASE)
# Misfit over that of three columns per bead that another number of columns must fall below.
CLEARLY, TINY = 0.5, 1e-30


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
    _complete_clock(roles, [c for c in group if said[id(c)] == Said()], natures)
    taken = {id(column) for column in roles.values() if column is not None}
    free = [c for c in group if id(c) not in taken]
    named = [c for c in free if said[id(c)].axis is not None]
    if look.kind == "gr":  # one bead's height, which its program plots as y
        (height,) = (c for c in named if c.name == "y")
        found = Found((Bead("b1", {"z": height}),), [{"name": "b1", "z": "y"}], "PicoTwist's plot")
    elif named and (pair := _array_alone(named)) is None:
        found = _by_names(named, look)
        whole = with_lateral_arrays(found.beads, [c for c in free if c not in named], natures)
        if whole != found.beads:
            how = f"{found.how}; arrays of two beside them are taken for x and y"
            found = Found(whole, patterns(whole), how)
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


def _complete_clock(
    roles: dict[str, Column | None], unnamed: Sequence[Column], natures: dict[int, Nature]
) -> None:
    """Take a clock by its values and its unit of time, where no name in a known language says it.

    Parameters
    ----------
    unnamed : columns whose names say nothing.
    """
    for column in unnamed:
        climbs = natures[id(column)] in ("clock", "count")
        if roles["time"] is None and climbs and stated_unit([column]) in SECONDS_PER_UNIT:
            roles["time"] = column


def _array_alone(named: Sequence[Column]) -> list[Column] | None:
    """The columns of one array `x` of two or three columns: the axes of one bead."""
    matches = [ARRAY.fullmatch(c.name) for c in named]
    bases = {match["base"] for match in matches if match is not None}
    if None in matches or len(bases) != 1 or len(named) not in (2, 3):
        return None
    return list(named) if len({said_by(c.name).axis for c in named}) == 1 else None


def _by_names(named: Sequence[Column], look: Look) -> Found:
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
    names = names_of(list(owners))
    beads = tuple(Bead(n, axes) for n, axes in zip(names, owners.values(), strict=True))
    if not look.table.has_names:
        return Found(beads, [entry_of(bead) for bead in beads], "the names of the columns")
    return Found(beads, patterns(beads), "the names of the columns")


def _by_values(
    columns: Sequence[Column], natures: dict[int, Nature], roles: dict[str, Column | None]
) -> Found:
    """Beads among columns whose names say nothing of axes; completes the roles."""
    bases: dict[str, list[Column]] = {}
    for column in columns:
        match = ARRAY.fullmatch(column.name)
        bases.setdefault(match["base"] if match else "", []).append(column)
    if not bases:
        return Found((), [], "")
    found = of_many_arrays(bases, natures)
    if found is not None:
        return found
    base, members = max(bases.items(), key=lambda one: len(one[1]))
    indices = [match["index"] for c in members if (match := ARRAY.fullmatch(c.name))]
    if indices and "," in indices[0]:
        return of_three_axes(base, members)
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
        return Found((), [], "")
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
        return Found(beads, [entry_of(beads[0])], how)
    entry = {"first_column": rest[0].told, "order": order.ljust(width, "_"), "names": names}
    return Found(beads, [entry], how)


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
