"""What a film tells: its frame rate, the size of a pixel, its beads and how they move.

The first frames are tracked as `mtpipe track` would, which is enough to see which beads are fixed.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mtpipe.ground.errors import MtpipeError, RecordingError, SetupError
from mtpipe.ground.files import as_text
from mtpipe.ground.processes import executor
from mtpipe.ground.types import FloatArray, NamedProgress
from mtpipe.ingest.column_attributes import PLACEHOLDER_HZ, RATE_TOLERANCE
from mtpipe.proposal.asking import Asking
from mtpipe.proposal.beads import put_field, put_references
from mtpipe.proposal.draft import USUAL, Draft
from mtpipe.proposal.laboratory_files import GivenFilm
from mtpipe.proposal.layout import log_seconds, put_log
from mtpipe.proposal.look import look_at
from mtpipe.proposal.magnet_log import NO_MAGNETS, clock_offset, find_log
from mtpipe.proposal.questions import ASKED, USUAL_PIXEL_NM, put_usual
from mtpipe.proposal.rest import rest_of
from mtpipe.setup.measured import UNKNOWN
from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.source_parts import NM_PER_UNIT
from mtpipe.tracking.chunks import Work, tracked_chunks
from mtpipe.tracking.lookup_table import LookUpTable
from mtpipe.tracking.measured import DEFAULT_METHOD
from mtpipe.tracking.regions import regions_of, tables_of
from mtpipe.tracking.stack import Stack, find_files, open_stack
from mtpipe.tracking.stack_look import Reading
from mtpipe.tracking.stack_times import frame_times
from mtpipe.tracking.tiff import opened

# Some seconds of most films, and tracked within a minute.
FRAMES = 1024
# Where the film does not tell its rate: motions are compared, and none is given in numbers.
STAND_IN_HZ = 100.0
NM_PER = {"nm": 1.0, "nanometer": 1.0, "um": 1e3, "µm": 1e3, "μm": 1e3, "micron": 1e3,
          "microns": 1e3, "micrometer": 1e3, "\\u00b5m": 1e3, "mm": 1e6}  # fmt: skip
# A pixel in the sample; what programs write that do not know it is 1 µm, 1 inch/72 and the like.
PIXELS_NM = (20.0, 900.0)
NO_TABLE = (
    "No look-up table lies beside the film. Without one z stays empty, and there is no force. Make "
    "one of a focus scan: mtpipe lut SCAN.tif --z positions.csv --out bead.npz; then say mtpipe "
    "init --overwrite"
)


@dataclass(frozen=True, eq=False)
class Film:
    """A film looked at.

    `rate_hz`, `pixel_nm` and `time_s` are None where it does not say; `beside` are the files around
    it, and `tables` the look-up tables among them, by the bead they were made of.
    """

    stack: Stack
    rate_hz: float | None
    rate_words: str
    pixel_nm: float | None
    time_s: FloatArray | None
    beside: tuple[Path, ...]
    tables: dict[str, Path] = field(default_factory=dict)


def propose_film(
    given: GivenFilm, home: Path, draft: Draft, asking: Asking, progress: NamedProgress
) -> list[str]:
    """Draft all that a film tells; gives what was seen, a line each.

    home : the setup's folder, which its file names are relative to.

    Raises
    ------
    MtpipeError : it is no film, or has no beads.
    """
    if draft.states_some("source.scale") or draft.states_some("source.units"):
        raise SetupError(
            "scale and units of [source] are for files of numbers; this is a film",
            where="answers",
            mend="Leave them out. The refraction along z goes into the look-up table (mtpipe lut "
            "--refractive-index-factor).",
        )
    take = (draft.get("tracking") or {}).get("incomplete") == "take"
    channels = (draft.get("tracking") or {}).get("frames") == "channels"
    film = look_at_film(given, Reading(channels, take), progress)
    _put_rate(draft, asking, film)
    if film.pixel_nm is not None:
        draft.put(
            "camera.pixel_size_nm", film.pixel_nm, "as the film or its table says", guess=True
        )
    else:
        asking.about("camera.pixel_size_nm", ASKED["camera.pixel_size_nm"], USUAL_PIXEL_NM, USUAL)
    logged = _put_log(draft, film, home)
    positions = _first_positions(draft, film, home, progress)
    rate = draft.get("camera.frame_rate_hz")
    rate = rate if isinstance(rate, float) else STAND_IN_HZ
    put_references(draft, asking, positions, rate)
    fixed = draft.get("beads.reference") or []
    put_field(draft, asking, {b: p for b, p in positions.items() if b not in fixed}, rate)
    if film.tables and not draft.states_some("source"):
        _put_surface(draft, [positions[bead][:, 2] for bead in fixed if bead in positions])
    seen = [
        f"Film: {film.stack.name}, {film.stack.frames} frames of {film.stack.width} × "
        f"{film.stack.height} pixels",
        f"{len(positions)} beads ({', '.join(list(positions)[:6])}), tracked in the first "
        f"{len(next(iter(positions.values())))} frames",
    ]
    if not film.tables:
        seen.append(NO_TABLE)
    if not logged:
        seen.append(NO_MAGNETS)
    return seen


def _put_surface(draft: Draft, heights_nm: Sequence[FloatArray]) -> None:
    """Put where z = 0 is, by the heights of the reference beads in the look-up table."""
    known = [float(np.nanmedian(z)) for z in heights_nm if np.isfinite(z).any()]
    if known:
        # only the film's beginning was tracked, so that no stretch is known to be one of touch
        why = (
            "a guess: reference beads have this height in the look-up table. If beads lie on the "
            "surface for some time, say when instead, as such a stretch has no force: "
            "z_zero = { touch_time_s = [0.0, 30.0], no_plateau = true }"
        )
        draft.put("source.z_zero.value_nm", float(f"{np.mean(known):.5g}"), why, guess=True)
        return
    low = "the stretch in which beads touch the surface: touch_time_s = [0.0, 30.0]"
    draft.put("source.z_zero", {"unknown": True}, f"no force until it is known; write {low}")


def _put_rate(draft: Draft, asking: Asking, film: Film) -> None:
    """Put the frame rate; where a person knows it better than the film, the film's is put aside."""
    told = film.rate_hz
    if told is not None and told != PLACEHOLDER_HZ:
        why = f"from the film: {film.rate_words}"
        draft.put("camera.frame_rate_hz", told, why, guess=True)
    else:
        question = ASKED["camera.frame_rate_hz"]
        why = "the film does not say it: write it here"
        asking.about("camera.frame_rate_hz", question, UNKNOWN, why)
    stated = draft.get("camera.frame_rate_hz")
    if told is not None and (stated == UNKNOWN or abs(stated / told - 1) > RATE_TOLERANCE):
        why = f"the film's own times make {told:g} frames per second ({film.rate_words})"
        draft.put("tracking.times", "setup", why, guess=True)


def _put_log(draft: Draft, film: Film, home: Path) -> bool:
    """Put the magnets' log, if a file beside the film is one, and what a plateau is by it."""
    if draft.states_some("tracking.magnet"):
        return True
    looks = []
    for file in film.beside:
        if file in film.tables.values():
            continue
        try:
            looks.append(look_at(file))
        except MtpipeError:
            continue  # look-up tables, notes
    log = find_log(looks, film.stack.frames, film.stack.name)
    if log is None:
        return False
    name = as_text(log.look.path.name)
    if log.time is None:
        put_log(draft, log, home, 0.0, f"{name} has a row for each frame", "tracking")
        return True
    at = log_seconds(log, None)
    rate = draft.get("camera.frame_rate_hz")
    if film.time_s is not None:
        film_s = film.time_s
    elif isinstance(rate, (int, float)):
        film_s = np.arange(film.stack.frames) / rate
    else:
        film_s = np.linspace(0.0, at[-1] - at[0], film.stack.frames)
    # without heights: the log's clock is the film's, or both begin together
    found = clock_offset(at, log.magnet.seconds, film_s, [], related=not log.time.is_clock)
    how = "its clock is taken for the film's" if found.plain else "both are taken to begin together"
    why = f"{name}; {how}; mtpipe run checks it by how the beads move"
    put_log(draft, log, home, found.seconds, why, "tracking")
    unit = (draft.get("tracking.magnet") or {})["unit"]
    rest = rest_of(at, log.magnet.seconds * NM_PER_UNIT[unit] / 1e6, log=True)
    for key, value in rest.choices.items():
        draft.put(f"plateaus.{key}", value, rest.why[key], guess=True)
    return True


def _first_positions(
    draft: Draft, film: Film, home: Path, progress: NamedProgress
) -> dict[str, FloatArray]:
    """Positions in the first frames, and the look-up tables of the beads that have one."""
    trial = draft.copied()
    trial.fixed.clear()
    trial.put("beads.reference", [])
    trial.put("field.direction", "x")
    put_usual(trial)
    trial.drop("tracking.magnet")
    if trial.get("camera.frame_rate_hz") == UNKNOWN:
        trial.put("camera.frame_rate_hz", STAND_IN_HZ)
        trial.put("tracking.times", "setup")
    if film.tables and not draft.states_some("tracking"):
        names = {bead: os.path.relpath(path, home) for bead, path in film.tables.items()}
        first = next(iter(names.values()))
        own = {"look_up_table_of": names}, "found beside the film, one for each bead by its name"
        of_one = {"look_up_table": first}, "found beside the film; of one bead, and beads differ"
        tries: list[tuple[dict[str, Any], str]] = [own] if len(names) > 1 else []
        for keys, why in [*tries, of_one]:
            one = trial.copied()
            one.put("tracking", keys)
            try:
                found = first_positions(film, home, parse_setup(one.content), progress)
            except MtpipeError:
                continue  # tables of beads that are not found
            for key, value in keys.items():
                draft.put(f"tracking.{key}", value, why, guess=True)
            return found
    return first_positions(film, home, parse_setup(trial.content), progress)


def look_at_film(given: GivenFilm, reading: Reading, progress: NamedProgress) -> Film:
    """Look at all pages of a film.

    Raises
    ------
    RecordingError : it is no film, as `open_stack` says.
    """
    path = given.path
    stack = open_stack(path, lambda done, n: progress("looking at the stack", done, n), reading)
    rate, words, time_s = None, "", None
    if stack.stamps is not None:
        try:
            time_s, _ = frame_times(stack.stamps, stack.frames, None)
        except RecordingError:
            pass  # what it says cannot be; the user's word is needed
        else:
            rate = float(f"{(len(time_s) - 1) / (time_s[-1] - time_s[0]):.6g}")
            words = stack.stamps.source
    tables = {}
    pixel_nm = _pixel_nm(find_files(path)[0])
    for file in given.beside:
        if file.suffix == ".npz":
            try:
                table = LookUpTable.load(file)
            except MtpipeError:
                continue  # some other archive
            tables[table.bead] = file
            pixel_nm = pixel_nm or table.pixel_size_nm
    return Film(stack, rate, words, pixel_nm, time_s, given.beside, tables)


def first_positions(
    film: Film, home: Path, setup: Setup, progress: NamedProgress
) -> dict[str, FloatArray]:
    """Positions of the beads found in the first frames, (n, 3) nm.

    Raises
    ------
    MtpipeError : no bead is found, or a look-up table does not fit.
    """
    pixel = setup.camera.pixel_size_nm
    assert pixel is not None
    assert pixel.value is not None
    tables = tables_of(setup.tracking, home, pixel.value)
    regions, _ = regions_of(film.stack, setup, tables)
    work = Work(
        film.stack,
        DEFAULT_METHOD,
        tables,
        film.stack.highest,
        pixel.value,
        {region.name: region for region in regions},
    )
    found: dict[str, list[FloatArray]] = {region.name: [] for region in regions}
    with executor(1) as pool:
        for start, done in tracked_chunks(work, pool, 1):
            for bead, rows in done.items():
                found[bead].append(np.column_stack([rows.x_nm, rows.y_nm, rows.z_nm]))
            progress("tracking the first frames", start, min(FRAMES, film.stack.frames))
            if start + len(done[regions[0].name].x_nm) >= FRAMES:
                break
    return {bead: np.concatenate(pieces) for bead, pieces in found.items()}


def _pixel_nm(path: Path) -> float | None:
    """Size of a pixel by the metadata of OME or ImageJ, if it can be one."""
    with opened(path, ome=True) as (tif, _):
        size, unit = 0.0, ""
        if tif.is_ome and tif.ome_metadata:
            from xml.etree import ElementTree

            try:
                root = ElementTree.fromstring(tif.ome_metadata)
            except ElementTree.ParseError:
                return None
            for pixels in root.iter():
                if pixels.tag.endswith("}Pixels") or pixels.tag == "Pixels":
                    try:
                        size = float(pixels.get("PhysicalSizeX", "0"))
                    except ValueError:
                        return None
                    unit = pixels.get("PhysicalSizeXUnit", "µm")
        elif tif.is_imagej:
            unit = str((tif.imagej_metadata or {}).get("unit", ""))
            tag = tif.pages[0].tags.get("XResolution")  # type: ignore[union-attr]
            if tag is not None and tag.value[0]:
                size = tag.value[1] / tag.value[0]
    nm = size * NM_PER.get(unit, 0.0)
    return float(f"{nm:.5g}") if PIXELS_NM[0] <= nm <= PIXELS_NM[1] else None
