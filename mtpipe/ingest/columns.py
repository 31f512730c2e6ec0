"""Which column of a file is what, and in which unit.

`canonical_columns` knows the names of FORMATS section 1; `source_columns` follows the setup's
`[source]`. Both answer with an `Assignment`: positions of columns (from 0) and the factors that
make nm, s, mm and turns of them.
"""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from mtpipe.ground.errors import RecordingError, SetupError
from mtpipe.ingest.column_attributes import Stated
from mtpipe.ingest.names import plain
from mtpipe.ingest.units import unit_of
from mtpipe.recording.recording import AXES
from mtpipe.setup.setup import Setup
from mtpipe.setup.source_parts import (
    NM_PER_UNIT,
    NUMBER,
    SECONDS_PER_UNIT,
    TURNS_PER_UNIT,
    UNKNOWN_UNIT,
    BeadColumns,
)
from mtpipe.setup.source_table import Source

QUALITY_NAME = re.compile(r"(?P<bead>.+)_quality")
# Columns of one array are listed one by one up to this number.
MOST_MEMBERS = 6
POSITION_NAME = re.compile(r"(?P<bead>.+)_(?P<axis>[xyz])_nm")


@dataclass(frozen=True)
class Assignment:
    """Columns by what they are; -1 for what the file does not have.

    `beads` maps a bead's name to the columns of x, y and z; `factors` are nm per unit of x, y, z;
    `time_s`, `magnet_mm` and `turns` are the factors of those columns.
    """

    beads: Mapping[str, tuple[int, int, int]]
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    time: int = -1
    time_s: float = 1.0
    frame: int = -1
    magnet: int = -1
    magnet_mm: float = 1.0
    magnet_offset_mm: float = 0.0
    rotation: int = -1
    turns: float = 1.0
    unused: tuple[str, ...] = field(default=())


@dataclass(frozen=True)
class Names:
    """Names of a file's columns and how to look one up.

    `unusable` says of what else the file holds why it is no column.
    """

    names: tuple[str, ...]
    has_names: bool
    where: str
    unusable: Mapping[str, str] = field(default_factory=dict)
    stated: Sequence[Stated] = ()

    def unit_of_all(self, columns: Iterable[int], axis: str) -> str:
        """The unit that the file states for columns of an axis.

        Raises
        ------
        SetupError : it states none that is known, or several.
        """
        said = [self.stated[c].unit if c < len(self.stated) else "" for c in columns if c >= 0]
        units = {unit_of(one) for one in said}
        unit = units.pop() if len(units) == 1 else None
        if unit not in NM_PER_UNIT and (unit != "pixel" or axis == "z"):
            told = ", ".join(sorted({repr(one) for one in said if one})) or "nothing"
            raise SetupError(
                f'[source.units] {axis} is "unknown", and of its unit the file says {told}',
                where=self.where,
                mend="Give the unit.",
            )
        return unit

    def find(self, column: int | str, what: str) -> int:
        """Position, from 0, of a column told by number or by name.

        Raises
        ------
        RecordingError : there is no such column, or two of that name.
        """
        if isinstance(column, int):
            if column > len(self.names):
                raise RecordingError(
                    f"column {column} ({what}) is asked for, but there are {len(self.names)}",
                    where=self.where,
                    mend=f"There are: {_some(self.names)}." if self.has_names else None,
                )
            return column - 1
        matches = [i for i, name in enumerate(self.names) if name == column]
        matches = matches or [i for i, n in enumerate(self.names) if plain(n) == plain(column)]
        if len(matches) == 1:
            return matches[0]
        if len(matches) > 1:
            raise RecordingError(
                f"two columns are named {column!r} ({what})",
                where=self.where,
                mend="Tell them by number.",
            )
        if not self.has_names:
            raise RecordingError(
                f"column {column!r} ({what}) is asked for, but the columns have no names",
                where=self.where,
                mend="Tell them by number, or set header = true.",
            )
        raise self.absent(column, what)

    def absent(self, column: str, what: str) -> RecordingError:
        """What to say of a name that no column has."""
        held = next(
            (key for key in self.unusable if f"{plain(column)}/".startswith(f"{plain(key)}/")), None
        )
        inner = tuple(name for name in self.names if name.startswith((f"{column}[", f"{column}/")))
        if held is not None:
            return RecordingError(
                f"{column!r} ({what}) is there, but is no column of numbers: {self.unusable[held]}",
                where=self.where,
                mend=f"Columns are: {_some(self.names)}.",
            )
        if inner:
            return RecordingError(
                f"{column!r} ({what}) is there, but has {len(inner)} columns",
                where=self.where,
                mend=f"Name one of them: {_some(inner)}.",
            )
        near = difflib.get_close_matches(column, self.names, n=1, cutoff=0.5)
        hint = f"Did you mean {near[0]}? " if near else ""
        return RecordingError(
            f"there is no column {column!r} ({what})",
            where=self.where,
            mend=f"{hint}{self.there}",
        )

    @property
    def there(self) -> str:
        """What the file holds, in a sentence or two."""
        others = [f"{key} ({what_it_is})" for key, what_it_is in self.unusable.items()]
        more = f" Unusable: {_some(tuple(others))}." if others else ""
        return f"There are: {_some(self.names)}.{more}"


def canonical_columns(names: Names) -> Assignment:
    """Columns of a canonical recording.

    Raises
    ------
    RecordingError : no time or frame number, no bead, or a name that occurs twice.
    """
    called = [plain(name) for name in names.names]
    for name in called:
        if name and called.count(name) > 1:
            raise RecordingError(f"has two columns named {name!r}", where=names.where)
    found: dict[str, list[int]] = {}
    unused = []
    for i, name in enumerate(called):
        match = POSITION_NAME.fullmatch(name)
        if match:
            found.setdefault(match["bead"], [-1, -1, -1])[AXES.index(match["axis"])] = i
        elif name and name not in ("time_s", "frame", "magnet_mm", "magnet_turns"):
            unused.append(name)
    # the tracker's own measure of each position: frames that failed are empty already
    unused = [
        name
        for name in unused
        if not ((of := QUALITY_NAME.fullmatch(name)) and of["bead"] in found)
    ]
    place = {name: i for i, name in enumerate(called)}
    time, frame = place.get("time_s", -1), place.get("frame", -1)
    hint = (
        f"It has: {_some(names.names)}. Files of another layout need a [source] table that names "
        "the beads' columns."
    )
    for mark, delimiter in ((";", "semicolon"), ("\t", "tab")):
        if len(names.names) == 1 and mark in names.names[0]:
            hint = (
                f'Its columns are separated by {delimiter}s: write delimiter = "{delimiter}" in '
                '[source], and decimal = "," if the numbers have commas.'
            )
    if time < 0 and frame < 0:
        raise RecordingError("has no column time_s or frame", where=names.where, mend=hint)
    if not found:
        raise RecordingError("has no column <bead>_x_nm", where=names.where, mend=hint)
    return Assignment(
        beads={bead: (c[0], c[1], c[2]) for bead, c in found.items()},
        time=time,
        frame=frame,
        magnet=place.get("magnet_mm", -1),
        rotation=place.get("magnet_turns", -1),
        unused=tuple(unused),
    )


def source_columns(names: Names, source: Source, setup: Setup) -> Assignment:
    """Columns of a laboratory's own file.

    Raises
    ------
    RecordingError : a column that `[source]` names is not there.
    SetupError : a unit is missing.
    """
    beads: dict[str, tuple[int, int, int]] = {}
    for entry in source.beads:
        for bead, columns in _beads_of(entry, names).items():
            if bead in beads:
                raise SetupError(f"[source.beads] two beads are named {bead!r}")
            beads[bead] = columns
    if not beads:
        raise RecordingError(
            "has no column that [source.beads] describes", where=names.where, mend=names.there
        )
    magnet, rotation = source.magnet, source.rotation
    own_magnet = magnet is not None and not magnet.is_log
    own_rotation = rotation is not None and not rotation.in_log
    return Assignment(
        beads=beads,
        factors=(
            _factor("x", beads, source, setup, names),
            _factor("y", beads, source, setup, names),
            _factor("z", beads, source, setup, names),
        ),
        time=names.find(source.time.column, "time") if source.time else -1,
        time_s=SECONDS_PER_UNIT[source.time.unit] if source.time else 1.0,
        frame=names.find(source.frame.column, "frame") if source.frame else -1,
        magnet=names.find(magnet.column, "magnet") if magnet and own_magnet else -1,
        magnet_mm=magnet.scale * NM_PER_UNIT[magnet.unit] / 1e6 if magnet else 1.0,
        magnet_offset_mm=magnet.offset_mm if magnet else 0.0,
        rotation=names.find(rotation.column, "rotation") if rotation and own_rotation else -1,
        turns=TURNS_PER_UNIT[rotation.unit] if rotation else 1.0,
    )


def _beads_of(entry: BeadColumns, names: Names) -> dict[str, tuple[int, int, int]]:
    if entry.first_column is not None:
        return _repeating(entry, names)
    if entry.is_pattern:
        return _numbered(entry, names)
    assert entry.name is not None
    column = {a: names.find(c, f"{entry.name} {a}") for a, c in entry.axes.items()}
    return {entry.name: (column.get("x", -1), column.get("y", -1), column.get("z", -1))}


def _repeating(entry: BeadColumns, names: Names) -> dict[str, tuple[int, int, int]]:
    assert entry.first_column is not None
    first, width = names.find(entry.first_column, "first bead"), len(entry.order)
    count = (len(names.names) - first) // width
    called = entry.names or tuple(f"b{k + 1}" for k in range(count))
    if len(called) > count:
        raise RecordingError(
            f"has {len(names.names)} columns, which is room for {count} beads of {width} from "
            f"column {first + 1}, but [source.beads] names {len(called)}",
            where=names.where,
        )
    beads = {}
    for k, bead in enumerate(called):
        at = [entry.order.find(axis) for axis in AXES]
        columns = [first + k * width + a if a >= 0 else -1 for a in at]
        beads[bead] = (columns[0], columns[1], columns[2])
    if len(beads) < len(called):
        raise SetupError("[source.beads] names: a name occurs twice")
    return beads


def _numbered(entry: BeadColumns, names: Names) -> dict[str, tuple[int, int, int]]:
    found: dict[str, list[int]] = {}
    numbers: dict[str, str] = {}
    for axis, column in entry.axes.items():
        head, _, tail = plain(str(column)).partition(NUMBER)
        pattern = re.compile(rf"{re.escape(head)}(\d+){re.escape(tail)}")
        for i, name in enumerate(names.names):
            match = pattern.fullmatch(plain(name))
            if match:
                bead = (entry.name or f"b{NUMBER}").replace(NUMBER, match[1])
                found.setdefault(bead, [-1, -1, -1])[AXES.index(axis)] = i
                numbers[bead] = match[1]
    for bead, columns in found.items():
        for axis, column in entry.axes.items():
            if columns[AXES.index(axis)] < 0:
                wanted = str(column).replace(NUMBER, numbers[bead])
                raise names.absent(wanted, f"{bead} {axis}")
    return {bead: (c[0], c[1], c[2]) for bead, c in found.items()}


def _factor(
    axis: str,
    beads: Mapping[str, tuple[int, int, int]],
    source: Source,
    setup: Setup,
    names: Names,
) -> float:
    scale = float(getattr(source.scale, axis))
    unit = source.units.of(axis)
    if unit is None or all(c[AXES.index(axis)] < 0 for c in beads.values()):
        return scale
    if unit == UNKNOWN_UNIT:
        unit = names.unit_of_all((c[AXES.index(axis)] for c in beads.values()), axis)
    if unit != "pixel":
        return scale * NM_PER_UNIT[unit]
    own = source.units.pixel_size_x_nm if axis == "x" else source.units.pixel_size_y_nm
    camera = setup.camera.pixel_size_nm
    size = own if own is not None else (camera.value if camera is not None else None)
    if size is None:
        raise SetupError(
            f"[source.units] {axis} is in pixels, but the size of a pixel is missing",
            mend=f"Give camera.pixel_size_nm, or source.units.pixel_size_{axis}_nm.",
        )
    return scale * size


def _some(names: tuple[str, ...]) -> str:
    """The first names, columns of one array as `a[1] to a[9]`."""
    shown = []
    for array, group in itertools.groupby(names, key=lambda name: name.partition("[")[0]):
        members = list(group)
        together = len(members) > MOST_MEMBERS and array
        shown += (
            [f"{members[0]} to {members[-1]}"] if together else [m or "(empty)" for m in members]
        )
    return ", ".join(shown[:12])[:400] + (", ..." if len(shown) > 12 else "")
