"""The `[source]` table of files that were looked at, and what their remarks say."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.columns import Names, canonical_columns
from mtpipe.ingest.data_files import open_stream
from mtpipe.ingest.instants import since
from mtpipe.ingest.text import TextTable
from mtpipe.proposal.attributes import said_beside
from mtpipe.proposal.columns import Columns
from mtpipe.proposal.draft import Draft
from mtpipe.proposal.laboratory_files import FoundFiles
from mtpipe.proposal.look import Column, Look
from mtpipe.proposal.magnet_log import Log
from mtpipe.proposal.nature import lost_marks
from mtpipe.proposal.questions import NUMBER, UNITS, parsed
from mtpipe.proposal.units import (
    is_plausible,
    magnet_unit,
    position_unit,
    rotation_unit,
    stated_unit,
    time_unit,
)
from mtpipe.setup.source_parts import NM_PER_UNIT, SECONDS_PER_UNIT, TURNS_PER_UNIT

REMARK_LINES = 200


@dataclass(frozen=True)
class Remark:
    """A key that a file's remarks may state: words for it, and the range in which it can be.

    `bare` : a number without a unit is taken in the key's own.
    """

    key: str
    words: str
    range: tuple[float, float]
    bare: bool = False


REMARKS = (
    Remark(
        "camera.frame_rate_hz",
        r"frame\s*rate|frames?\s*(?:per|/)\s*s\w*|\bfps|bildrate|abtastrate|"
        r"sampl\w*\s*(?:rate|freq\w*)|cadence|images?\s*(?:par|/)\s*s\w*|"
        r"fr[ée]quence\s*(?:d['’ ]\s*)?(?:images?|acquisition|[ée]chantillonnage)|"
        r"im[aá]genes\s*(?:por|/)\s*s\w*|frecuencia\s*de\s*(?:im\w+|muestreo|adquisici[oó]n)|"
        r"beeld(?:snelheid|frequentie)|beelden\s*(?:per|/)\s*s\w*|bemonsteringsfrequentie|"
        r"frequenza\s*(?:d\w+\s*)?(?:fotogrammi|immagini|campionamento|acquisizione)|"
        r"(?:fotogrammi|immagini)\s*(?:al|/)\s*s\w*",
        (1.0, 1e5),
        bare=True,
    ),
    Remark(
        "camera.exposure_s",
        r"exposure(?:\s*time)?|belicht[iu]ng\w*|shutter(?:\s*time)?|integration\s*time|"
        r"temps\s*(?:de\s*pose|d['’ ]\s*(?:exposition|int[ée]gration))|"
        r"exposition|exposici[oó]n|sluitertijd|(?:tempo\s*di\s*)?(?:esposizione|posa)",
        (1e-6, 1.0),
    ),
    Remark(
        "camera.pixel_size_nm",
        r"pixel\s*(?:size|width|calibration)|pixelgr\w+|taille\s*(?:de|du|d['’ ]un)?\s*pixels?|"
        r"p[ií]xels?(?=[^\d,;\n]*[:=])",
        (10.0, 1000.0),
    ),
    Remark("camera.pixel_size_nm", r"nm\s*(?:per|/)\s*(?:px|pixel)", (10.0, 1000.0), bare=True),
    Remark("buffer.temperature_K", r"temp\w*", (270.0, 350.0)),
)


def put_layout(draft: Draft, found: FoundFiles, folder: Path) -> None:
    """Put the `[source]` table of a recording that no preset describes; the magnets' log aside."""
    look, columns = found.look, found.columns
    put_files(draft, folder, found.files)
    canonical = look.kind in ("text", "parquet") and _is_canonical(look)
    if not canonical:
        draft.put("source.format", look.kind)
    if isinstance(look.table, TextTable):
        _put_text(draft, look, look.table, canonical)
    if "incomplete" in look.layout:
        draft.put(
            "source.incomplete", "take", "the file is cut off: what is whole is taken", guess=True
        )
    if canonical:
        return
    _put_clock(draft, found)
    put_position_units(draft, columns)
    _put_lost(draft, look, columns)
    if columns.magnet is not None:
        _put_magnet(draft, columns.magnet)
    if columns.rotation is not None and columns.magnet is not None:
        _put_rotation(draft, columns.rotation, found.of_all(columns.rotation))
    entries = columns.entries
    how = columns.how
    if found.together == "beads":
        (entry,) = entries[:1]
        entries = [{**entry, "name": "{name}"}]
        how = "one file for each bead, called as its file"
    draft.put("source.beads", entries[0] if len(entries) == 1 else entries, f"by {how}", guess=True)


def put_files(draft: Draft, folder: Path, files: Sequence[Path]) -> None:
    """Put the names of the recording's files, by a pattern where it fits them and no other."""
    names = [_shown(os.path.relpath(file, folder)) for file in files]
    if len(names) > 3:
        suffix = "".join(files[0].suffixes[-2:]) if files[0].suffix == ".gz" else files[0].suffix
        home = files[0].parent
        if suffix and set(home.glob(f"*{suffix}")) == set(files):
            names = [_shown(os.path.join(os.path.relpath(home, folder), f"*{suffix}"))]
    draft.put("source.files", names[0] if len(names) == 1 else names)


def put_log(
    draft: Draft, log: Log, folder: Path, offset_s: float, why: str, table: str = "source"
) -> None:
    """Put the magnets' log and its clock into `[source]`, of a film into `[tracking]`."""
    unit, how = _unit_of(log.magnet, NM_PER_UNIT) or magnet_unit(log.magnet.seconds)
    content: dict[str, Any] = {"column": log.magnet.told, "unit": unit}
    own_file = draft.get("source.files") != _shown(os.path.relpath(log.look.path, folder))
    if own_file:
        content = {"file": _shown(os.path.relpath(log.look.path, folder)), **content}
    if log.time is not None:
        clock, _ = _time_of(log.time)
        content |= {"time_column": log.time.told, "time_unit": clock}
        if offset_s:
            content["clock_offset_s"] = offset_s
    else:
        content["row_by_row"] = True
    if own_file and isinstance(log.look.table, TextTable):
        content["delimiter"] = log.look.table.delimiter
        if log.look.table.decimal == ",":
            content["decimal"] = ","
        if not log.look.table.has_names:
            content["header"] = False
    draft.put(f"{table}.magnet", content, f"{why}; {how}", guess=True)
    if log.rotation is not None and table == "source":
        _put_rotation(draft, log.rotation, log.rotation.seconds, in_log=True)


def log_seconds(log: Log, clock: Column | None) -> FloatArray:
    """The log's own time in s, (n_log,), as reading has it.

    clock : the recording's column of times; both may be times of day.
    """
    assert log.time is not None
    if log.time.is_clock and clock is not None and clock.is_clock:
        return since(clock.values[0], log.time.values)
    unit, _ = _time_of(log.time)
    return np.asarray(log.time.seconds * (1.0 if log.time.is_clock else SECONDS_PER_UNIT[unit]))


def put_position_units(draft: Draft, columns: Columns) -> None:
    """Put the units of the positions, stated or guessed."""
    units: dict[str, str] = {}
    reasons: dict[str, str] = {}
    for axis in "xyz":
        of_axis = columns.of_axis(axis)
        if not of_axis:
            continue
        unit = stated_unit(of_axis)
        if unit is not None and not is_plausible(of_axis, unit):
            units[axis], why = position_unit(of_axis, axis)
            reasons[axis] = f"not {unit}, as the file says: {why}"
            if any(c.stated.unit and not c.stated.unit_in_name for c in of_axis):
                why = "the file's units cannot be right"
                draft.put("source.attributes", "setup", why, guess=True)
        elif unit in NM_PER_UNIT or (unit == "pixel" and axis != "z"):
            units[axis], reasons[axis] = str(unit), ""
        elif axis == "y" and "x" in units and not stated_unit(columns.of_axis("x")):
            units[axis], reasons[axis] = units["x"], reasons["x"]  # one camera
        else:
            units[axis], reasons[axis] = position_unit(of_axis, axis)
    if len(set(units.values())) == 1 and not draft.states_some("source.units"):
        why = next((r for r in reasons.values() if r), "as the file says")
        guessed = any(reasons.values())
        draft.put("source.units.position", next(iter(units.values())), why, guess=guessed)
        return
    for axis, unit in units.items():
        if draft.get("source.units.position") is not None:
            return
        why = reasons[axis] or "as the file says"
        draft.put(f"source.units.{axis}", unit, why, guess=bool(reasons[axis]))


def put_time_unit(draft: Draft, column: Column) -> None:
    """Put the unit of a preset's time stamps."""
    unit, why = _time_of(column)
    draft.put("source.time.unit", unit, why, guess=True)


def put_remarks(draft: Draft, look: Look) -> None:
    """Put what the lines before a text's numbers, or single numbers and attributes, state."""
    beside = said_beside(look.path, look.kind) | _numbers_alone(look)
    text = "\n".join(f"{name}: {value}" for name, value in beside.items())
    if isinstance(look.table, TextTable):
        text = _remarks_of(look.path, look.table)
    text = text.replace("_", " ")
    for remark in REMARKS:
        known = {u.casefold(): u for u in UNITS[remark.key.rpartition("_")[2]]}
        units = "|".join(re.escape(u) for u in sorted(known, key=len, reverse=True))
        unit = rf"(?:[(\[]?\s*({units})\b\s*[)\]]?)?"
        pattern = rf"(?:{remark.words})\s*{unit}[\s:;=,\t\"]*{NUMBER}\s*{unit}"
        for match in re.finditer(pattern, text, re.IGNORECASE):
            said = match[1] or match[3]
            if (said is None and not remark.bare) or draft.get(remark.key) is not None:
                continue
            name = known[said.casefold()] if said else ""
            value = parsed(remark.key, f"{match[2]} {name}")
            if remark.range[0] <= value <= remark.range[1]:
                why = f"as the file says: {match[0].strip()[:60]!r}"
                draft.put(remark.key, value, why, guess=True)


def _put_text(draft: Draft, look: Look, table: TextTable, canonical: bool) -> None:
    if not canonical or table.delimiter != "comma":
        draft.put("source.delimiter", table.delimiter)
    if table.decimal == ",":
        draft.put("source.decimal", ",", "numbers have decimal commas", guess=True)
    if not table.has_names:
        draft.put("source.header", False, "no line names the columns")
    if look.lost_tokens:
        draft.put(
            "source.lost.tokens", list(look.lost_tokens), "words among the numbers", guess=True
        )


def _put_clock(draft: Draft, found: FoundFiles) -> None:
    columns = found.columns
    restarts = {"restarts": True} if found.restarts else {}
    if columns.time is not None:
        unit, why = _time_of(columns.time)
        table: dict[str, Any] = {"column": columns.time.told, "unit": unit}
        stamps = columns.time.seconds
        if found.restarts and draft.get("camera.frame_rate_hz") is None:
            seconds = (stamps[-1] - stamps[0]) * (
                SECONDS_PER_UNIT[unit] if not columns.time.is_clock else 1
            )
            rate = float(f"{(len(stamps) - 1) / seconds:.6g}")
            draft.put("camera.frame_rate_hz", rate, "from the first file's time stamps", guess=True)
        if np.any(np.diff(stamps[np.isfinite(stamps)]) == 0):
            table["rounded"] = True
        draft.put("source.time", table | restarts, why, guess=True)
    if columns.frame is not None:
        draft.put(
            "source.frame",
            {"column": columns.frame.told, **restarts},
            "frame numbers",
            guess=True,
        )


def _time_of(column: Column) -> tuple[str, str]:
    """Unit of a column of times, and why."""
    if column.is_clock:
        return "s", "clock times"
    known = _unit_of(column, SECONDS_PER_UNIT)
    return known or time_unit(column.seconds)


def _unit_of(column: Column, known: Any) -> tuple[str, str] | None:
    unit = stated_unit([column])
    return (unit, "unit as the file says") if unit is not None and unit in known else None


def _put_magnet(draft: Draft, column: Column) -> None:
    unit, why = _unit_of(column, NM_PER_UNIT) or magnet_unit(column.seconds)
    draft.put("source.magnet", {"column": column.told, "unit": unit}, why, guess=True)


def _put_rotation(
    draft: Draft, column: Column, values: FloatArray, *, in_log: bool = False
) -> None:
    unit, why = _unit_of(column, TURNS_PER_UNIT) or rotation_unit(column.name, values)
    table: dict[str, Any] = {"column": column.told, "unit": unit}
    if in_log:
        table["in_log"] = True
    draft.put("source.rotation", table, why, guess=True)


def _put_lost(draft: Draft, look: Look, columns: Columns) -> None:
    """Put what means lost in numbers: rows of zeros, and one value far from all others."""
    positions = [c.seconds for bead in columns.beads for c in bead.axes.values()]
    zero = np.logical_and.reduce([values == 0 for values in positions])
    if np.count_nonzero(zero) > 1 and len(positions) > 1:
        draft.put("source.lost.all_zero_rows", True, "rows of zeros are no positions", guess=True)
    marks = {mark for values in positions for mark in lost_marks(values[~zero])}
    if marks:
        why = "far from all positions, and repeated"
        draft.put("source.lost.values", sorted(marks), why, guess=True)


def _is_canonical(look: Look) -> bool:
    table = look.table
    try:
        canonical_columns(Names(table.names, table.has_names, "", table.unusable))
    except MtpipeError:
        return False
    return True


def _remarks_of(path: Path, table: TextTable) -> str:
    """Lines before the numbers, and remarks at the file's beginning."""
    lines = []
    with open_stream(path) as stream:
        text = io.TextIOWrapper(stream, encoding=table.encoding, errors="replace")
        for k, line in zip(range(REMARK_LINES), text, strict=False):
            if k < table.skip or line.strip().startswith(table.comment or "\0"):
                lines.append(line)
    return "".join(lines)


def _numbers_alone(look: Look) -> dict[str, float]:
    """Single numbers that a file of arrays holds, by name."""
    found = dict(look.alone)
    for name, told in look.table.unusable.items():
        match = re.fullmatch(rf"a single \w+ \({NUMBER}\)", told)
        if match:
            found[name] = float(match[1])
    return found


def _shown(name: str) -> str:
    """A name as it can stand in the setup: signs that are no Unicode by a pattern."""
    return name.encode("utf-8", "replace").decode()
