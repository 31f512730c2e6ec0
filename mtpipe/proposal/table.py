"""A setup proposed for files of numbers: text, arrays, or an instrument's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.files import as_text
from mtpipe.ground.types import NamedProgress
from mtpipe.proposal.asking import Asking
from mtpipe.proposal.beads import (
    put_field,
    put_references,
    put_rest,
    put_surface,
    put_without_reading,
)
from mtpipe.proposal.draft import USUAL, Draft
from mtpipe.proposal.instrument import magscope_files, preset_of
from mtpipe.proposal.laboratory_files import FoundFiles, find_files
from mtpipe.proposal.layout import (
    log_seconds,
    put_files,
    put_layout,
    put_log,
    put_position_units,
    put_remarks,
    put_time_unit,
)
from mtpipe.proposal.look import Column
from mtpipe.proposal.magnet_log import NO_MAGNETS, Log, clock_offset, find_log
from mtpipe.proposal.questions import ASKED, USUAL_PIXEL_NM
from mtpipe.proposal.trial import STAND_IN_HZ, FirstReading, first_reading
from mtpipe.recording.recording import Recording
from mtpipe.setup.measured import UNKNOWN
from mtpipe.setup.presets import CALISTO_TEXT, COLUMNS, MAGSCOPE_HDF5, SHON_TEXT

OIL_OBJECTIVE = 0.88


def propose_table(
    paths: Sequence[Path], folder: Path, draft: Draft, asking: Asking, say: NamedProgress
) -> list[str]:
    """Draft all that a recording in files of numbers tells."""
    say("looking at the files", 0, 1)
    found: FoundFiles | None = None
    log: Log | None = None
    files = magscope_files(paths)
    if files:
        put_files(draft, folder, files)
        draft.put("source.preset", MAGSCOPE_HDF5, "files of MagScope", guess=True)
    else:
        found = find_files(paths)
        files = found.files
        log = _put_found(found, folder, draft)
    _ask_about_columns(draft, asking)
    say("reading", 0, 1)
    seen = [_files_in_words(files, found)]
    try:
        first = first_reading(draft, folder)
    except MtpipeError as error:
        # what the user has to decide; the rest stands, and the reading after writing says it
        put_without_reading(draft)
        return [*seen, f"Its beads could not be looked at: {error}"]
    if _put_rate(draft, asking, first):
        first = first_reading(draft, folder)
    if log is not None:
        offset_s, why = _offset(
            log, first.recording, found.columns.time if found is not None else None
        )
        put_log(draft, log, folder, offset_s, why)
        say("reading", 0, 1)
        first = first_reading(draft, folder)
        if not first.rate_known and log.time is not None:
            draft.drop("source.magnet.clock_offset_s")
            why = (
                f"{as_text(log.look.path.name)}; how its clock stands is found with the frame rate"
            )
            draft.why["source.magnet"] = f"{why}: call mtpipe init again once that is known"
    recording = first.recording
    rate_hz = recording.setup.camera.frame_rate_hz.value or STAND_IN_HZ
    put_references(draft, asking, recording.positions_nm, rate_hz)
    fixed = draft.get("beads.reference") or []
    tethered = {b: xyz for b, xyz in recording.positions_nm.items() if b not in fixed}
    put_field(draft, asking, tethered, rate_hz)
    stretches = put_rest(draft, recording, log=log is not None and log.time is not None)
    if draft.get("source.beads") is not None or draft.get("source.preset") is not None:
        put_surface(draft, recording, stretches)
    unused = [c.name or "(empty)" for c in found.columns.unused] if found is not None else []
    if unused and draft.get("source.beads") is not None:
        seen.append(f"Columns that are not used: {_few(unused)}")
    if recording.magnet_mm is None:
        seen.append(NO_MAGNETS)
    seen.append(
        f"{len(recording.positions_nm)} beads ({_few(list(recording.positions_nm))}), "
        f"{len(recording.time_s)} frames"
    )
    return seen


def _put_found(found: FoundFiles, folder: Path, draft: Draft) -> Log | None:
    """Draft the layout; the magnets' log is given back, as its clock needs the beads."""
    preset = draft.get("source.preset") or preset_of(found)
    put_remarks(draft, found.look)
    if preset is None or preset == COLUMNS:
        put_layout(draft, found, folder)
        if found.columns.magnet is not None or draft.states_some("source.magnet"):
            return None
        return find_log(found.logs, found.look.rows, found.files[0].name, found.look)
    draft.put("source.preset", preset, "by the names and columns of the files", guess=True)
    put_files(draft, folder, found.files)
    if preset == CALISTO_TEXT:
        put_position_units(draft, found.columns)
        put_time_unit(draft, found.look.columns[1])
    if preset == SHON_TEXT:
        draft.put("camera.frame_rate_hz", UNKNOWN, "in the file c###.fps")
    return None


def _ask_about_columns(draft: Draft, asking: Asking) -> None:
    """Ask about units that were guessed, and the size of a pixel where there are any."""
    for axis, what in (("position", "the positions"), ("x", "x and y"), ("z", "z")):
        key = f"source.units.{axis}"
        if key in draft.guessed:
            unit, why = draft.get(key), draft.why[key]
            asking.about(key, f"Unit of {what}? nm, um, mm, m or pixel", unit, why)
            if axis == "x" and "source.units.y" in draft.guessed:  # one camera
                draft.put("source.units.y", draft.get(key), draft.why[key])
    units = draft.get("source.units") or {}
    sizes = ("pixel_size_x_nm", "pixel_size_y_nm")
    pixels = "pixel" in units.values() or draft.get("source.preset") == SHON_TEXT
    stated = any(size in units for size in sizes) or draft.get("camera.pixel_size_nm") is not None
    if pixels and not stated:
        question = ASKED["camera.pixel_size_nm"]
        asking.about("camera.pixel_size_nm", question, USUAL_PIXEL_NM, USUAL)
    if draft.get("source.preset") is None and ("z" in units or "position" in units):
        why = f"{OIL_OBJECTIVE} if z is not corrected for refraction (oil objective)"
        asking.about("source.scale.z", ASKED["source.scale.z"], 1.0, why)


def _offset(log: Log, recording: Recording, clock: Column | None) -> tuple[float, str]:
    name = as_text(log.look.path.name)
    if log.time is None:
        return 0.0, f"{name} has a row for each row of the recording"
    heights = [xyz[:, 2] for xyz in recording.positions_nm.values()]
    heights = [z for z in heights if np.isfinite(z).any()]
    log_s = log_seconds(log, clock)
    # a time of day and seconds since the start have no zero in common
    related = not log.time.is_clock or (clock is not None and clock.is_clock)
    found = clock_offset(log_s, log.magnet.seconds, recording.time_s, heights, related=related)
    if found.plain:
        return 0.0, f"{name} is on the recording's clock"
    if found.explains > 0:
        how = f"then the beads' heights follow the magnets best ({100 * found.explains:.0f} %)"
    else:
        how = "both are taken to begin together"
    if found.rival is not None:
        how += f". They follow them as well with {found.rival:g} s: which of the two is right?"
    return found.seconds, f"{name}; {found.seconds:g} s are added to its clock, as {how}"


def _put_rate(draft: Draft, asking: Asking, first: FirstReading) -> bool:
    """Put the frame rate; whether a person said it just now."""
    if draft.get("camera.frame_rate_hz") not in (None, UNKNOWN):
        return False
    if first.rate_known:
        rate = first.recording.setup.camera.frame_rate_hz.value
        draft.put("camera.frame_rate_hz", float(f"{rate:.6g}"), first.rate_words, guess=True)
        return False
    question = ASKED["camera.frame_rate_hz"]
    asking.about("camera.frame_rate_hz", question, UNKNOWN, "in none of the files: write it here")
    return bool(draft.get("camera.frame_rate_hz") != UNKNOWN)


def _files_in_words(files: Sequence[Path], found: FoundFiles | None) -> str:
    names = _few([as_text(file.name) for file in files])
    if len(files) == 1:
        return f"Recording: {names}"
    how = (
        "one file for each bead"
        if found is not None and found.together == "beads"
        else "one recording in time"
    )
    return f"Recording: {len(files)} files, {how} ({names})"


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
