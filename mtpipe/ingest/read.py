"""From files to a `Recording`: the steps of reading in their order."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from mtpipe.ground.errors import MtpipeError, RecordingError, SetupError
from mtpipe.ground.notice import Notice
from mtpipe.ingest.agreement import (
    StatedRate,
    check_columns,
    check_rate,
    rate_notice,
    stated_rate,
)
from mtpipe.ingest.arrays import open_arrays
from mtpipe.ingest.checks import check_beads, check_gaps
from mtpipe.ingest.clock import Clock, read_clock
from mtpipe.ingest.collect import Collected, OpenTable, RowChoice, collect
from mtpipe.ingest.columns import Assignment, Names, canonical_columns, source_columns
from mtpipe.ingest.contradictions import contradiction_notices
from mtpipe.ingest.data_files import Found, describe, find_recording
from mtpipe.ingest.instruments import look_at
from mtpipe.ingest.kinds import kind_of
from mtpipe.ingest.magnets import read_magnets
from mtpipe.ingest.magscope import open_magscope
from mtpipe.ingest.parquet import open_parquet
from mtpipe.ingest.repeats import without_repeats
from mtpipe.ingest.side_by_side import is_file_per_bead, side_by_side
from mtpipe.ingest.surface import find_surface, off_the_surface
from mtpipe.ingest.text import TextTable, open_text
from mtpipe.ingest.tracked import read_tracked
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Recording
from mtpipe.setup.measured import Measured
from mtpipe.setup.presets import MAGSCOPE_HDF5
from mtpipe.setup.setup import Setup
from mtpipe.setup.source_parts import Format, Layout
from mtpipe.setup.source_signals import Lost
from mtpipe.setup.source_table import Source
from mtpipe.setup.tables import Camera


def read_recording(path: Path, setup: Path | str | Setup | None) -> Recording:
    """Read a recording; parameters and errors as in `mtpipe.ingest.load`."""
    found, said = with_preset(find_recording(path, setup))
    source = found.setup.source
    lost = source.lost if source is not None else Lost()
    tables = _open(found.files, source)
    if source is not None and is_file_per_bead(source):
        joined, source = side_by_side(tables, source, found.folder)
        tables = [joined]
        setup = found.setup.model_copy(update={"source": source})
        found = dataclasses.replace(found, setup=setup)
    plans = [_assign(found.setup, table) for table in tables]
    checked = [check_columns(t, plan, source) for t, plan in zip(tables, plans, strict=True)]
    rows = RowChoice(source.keep_rows, source.skip_rows) if source is not None else RowChoice()
    data = collect(tables, partial(_assign, found.setup), lost, rows)
    contradictions = [one for _, ones in checked for one in ones]
    told = [one for ones, _ in checked for one in ones]
    told += contradiction_notices(contradictions, data, found.setup)
    rate = stated_rate(tables, plans, source, found.setup.camera.frame_rate_hz.value)
    locate = _locator(tables, data, rows)
    try:
        recording = _assembled(
            found.name, found.setup, data, found.files, found.folder, tables, locate, rate
        )
    except MtpipeError as error:
        if error.where is None and not isinstance(error, SetupError):
            error.where = found.name
        raise
    notices = (*said, *dict.fromkeys(told), *recording.notices)
    return dataclasses.replace(recording, notices=notices)


def with_preset(found: Found) -> tuple[Found, tuple[Notice, ...]]:
    """A recording with its preset completed from what its files say, and what is to be told."""
    if found.setup.source is None or found.setup.source.preset is None:
        return found, ()
    facts = look_at(found, found.setup.source)
    stated = found.setup.beads
    reference = tuple(dict.fromkeys((*stated.reference, *facts.references)))
    beads = stated.model_copy(update={"reference": reference})
    setup = found.setup.model_copy(update={"source": facts.source, "beads": beads})
    if facts.rate_hz is not None:
        setup = _with_rate(setup, facts.rate_hz)
    return dataclasses.replace(found, setup=setup, files=facts.files), facts.notices


def _open(files: tuple[Path, ...], source: Source | None) -> list[OpenTable]:
    if source is not None and source.preset == MAGSCOPE_HDF5:
        return list(open_magscope(files))
    stated = source if source is not None else Source()
    layout = stated if stated.beads else stated.canonical_text
    asked = (
        stated.names_asked
        if stated.beads
        else ("time_s", "frame", "magnet_mm", "magnet_turns", "_nm")
    )
    return [open_table(file, layout, stated.lost.tokens, asked) for file in files]


def open_table(
    path: Path,
    layout: Layout,
    lost_tokens: tuple[str, ...] = (),
    asked: tuple[str, ...] = (),
) -> OpenTable:
    """Open a file as a table of columns, by its kind and the layout.

    Parameters
    ----------
    lost_tokens, asked : words that mean lost, and names of columns that are asked for.

    Raises
    ------
    RecordingError : there is no such file, it is damaged, or of another kind than stated.
    """
    if not path.is_file():
        raise RecordingError("there is no such file", where=str(path))
    kind = kind_of(path)
    stated = layout.format
    if stated not in (None, "canonical", kind):
        raise RecordingError(
            f"is {_KINDS[kind]}, not {stated}",
            where=str(path),
            mend="Correct [source] format, or the preset that says so.",
        )
    if stated == "canonical" and kind not in ("text", "parquet"):
        raise RecordingError(
            f"is {_KINDS[kind]}", where=str(path), mend="Describe it in a [source] table."
        )
    if kind == "text":
        return open_text(path, layout, lost_tokens, asked)
    if kind == "parquet":
        return open_parquet(path, layout)
    return open_arrays(path, kind, layout)


_KINDS: dict[Format, str] = {
    "text": "text",
    "parquet": "a Parquet file",
    "matlab": "a MATLAB file",
    "hdf5": "an HDF5 file",
    "netcdf": "a netCDF 3 file",
    "tdms": "a LabVIEW TDMS file",
    "npz": "a numpy archive",
    "npy": "a numpy array",
    "gr": "a PicoTwist plot file",
}


def _assign(setup: Setup, table: OpenTable) -> Assignment:
    names = Names(table.names, table.has_names, str(table.path), table.unusable, table.stated)
    if setup.source is None or not setup.source.beads:
        return canonical_columns(names)
    return source_columns(names, setup.source, setup)


def _assembled(
    name: str,
    setup: Setup,
    data: Collected,
    files: tuple[Path, ...],
    folder: Path,
    tables: list[OpenTable],
    locate: Callable[[int], str],
    stated: StatedRate,
) -> Recording:
    source = setup.source
    rows = len(next(iter(data.positions_nm.values())))
    if rows < 2:
        raise RecordingError("has one row of numbers, and motion takes many")
    clock = _clock(data, setup, locate, stated)
    magnets = read_magnets(data, clock.time_s, clock.rate_hz, source, files, folder, open_table)
    positions = _without(data, source)
    sound = check_beads(positions, setup, clock.rate_hz)
    positions, repeats = without_repeats(sound.positions_nm, locate)
    plateaus = find_plateaus(
        clock.time_s, magnets.position_mm, setup.plateaus, resting=magnets.resting
    )
    recording = Recording(
        name=name,
        setup=_with_rate(setup, clock.rate_hz),
        time_s=clock.time_s,
        frame=clock.frame,
        positions_nm=positions,
        magnet_mm=magnets.position_mm,
        magnet_turns=magnets.turns,
        plateaus=plateaus,
        files=tuple(describe(file, folder) for file in files),
    )
    if not plateaus:
        raise _no_plateau(recording)
    said: tuple[Notice, ...] = ()
    if source is None or not source.beads:
        tracked, said = read_tracked(files)
        if tracked is None and source is not None and (source.z_zero or source.z_zero_of):
            raise SetupError(
                "[source] z_zero: in a canonical recording z is the height above the surface "
                "already, and is not shifted",
                mend="Leave z_zero out, or say in [source] beads which columns are what.",
            )
        recording = dataclasses.replace(recording, tracked=tracked)
    surface = find_surface(recording)
    away = _settled_away(recording, magnets.resting)
    recording, touching = off_the_surface(recording)
    for bead, height in surface.height_nm.items():
        positions[bead][:, 2] -= height
    notices = (
        *said,
        *_guesses(tables, source),
        *_remarks(data, positions),
        *clock.notices,
        *check_gaps(clock.frame, locate),
        *repeats,
        *magnets.notices,
        *away,
        *touching,
        *sound.notices,
        *surface.notices,
    )
    return dataclasses.replace(recording, notices=notices, z_zero_stderr_nm=surface.stderr_nm)


def _clock(
    data: Collected, setup: Setup, locate: Callable[[int], str], stated: StatedRate
) -> Clock:
    """The recording's clock, with the rate that the file states where nothing else tells it."""
    known_hz = setup.camera.frame_rate_hz.value
    by_file = known_hz is None and data.time_s is None and stated.hz is not None
    clock = read_clock(data, setup.source, stated.hz if by_file else known_hz, locate)
    said = [*stated.notices, *clock.notices]
    if by_file:
        said.append(rate_notice(stated))
    elif known_hz is None:
        check_rate(stated, clock.rate_hz, "the time stamps say")
    time_s = clock.time_s + stated.start_s if data.time_s is None else clock.time_s
    return dataclasses.replace(clock, time_s=time_s, notices=tuple(said))


def _settled_away(recording: Recording, resting: NDArray[np.bool_] | None) -> tuple[Notice, ...]:
    """Say how many dwells the settling time leaves too short to be plateaus."""
    choice = recording.setup.plateaus
    if choice.settle_s == 0:
        return ()
    unsettled = choice.model_copy(update={"settle_s": 0.0})
    dwells = find_plateaus(recording.time_s, recording.magnet_mm, unsettled, resting)
    gone = len(dwells) - len(recording.plateaus)
    if gone <= 0:
        return ()
    said = (
        f"{gone} of {len(dwells)} dwells of the magnets give no plateau: once [plateaus] settle_s "
        f"= {choice.settle_s:g} s is left out, less than minimum_s = {choice.minimum_s:g} s is "
        "left of them."
    )
    return (Notice("settled_away", "caution", said),)


def _without(data: Collected, source: Source | None) -> dict[str, np.ndarray]:
    out = source.leave_out if source is not None else ()
    absent = [bead for bead in out if bead not in data.positions_nm]
    if absent:
        raise SetupError(
            f"[source] leave_out names {absent[0]!r}, which is not in the recording",
            mend=f"It has: {', '.join(data.positions_nm)}.",
        )
    return {bead: xyz for bead, xyz in data.positions_nm.items() if bead not in out}


def _with_rate(setup: Setup, rate_hz: float) -> Setup:
    """The setup with the frame rate that was derived where it was unknown."""
    if setup.camera.frame_rate_hz.known:
        return setup
    fields = {name: getattr(setup.camera, name) for name in Camera.model_fields}
    try:
        camera = Camera.model_validate(fields | {"frame_rate_hz": Measured(value=rate_hz)})
    except ValidationError as error:
        text = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise SetupError(f"[camera] {text}") from None
    return setup.model_copy(update={"camera": camera})


def _no_plateau(recording: Recording) -> RecordingError:
    choice = recording.setup.plateaus
    total = recording.time_s[-1] - recording.time_s[0]
    if recording.magnet_mm is None or total < choice.minimum_s:
        return RecordingError(
            f"the recording lasts {total:.3g} s, a plateau at least {choice.minimum_s:g} s",
            mend="Lower [plateaus] minimum_s.",
        )
    if not np.isfinite(recording.magnet_mm).any():
        return RecordingError(
            "the magnets have no position in any row",
            mend="Fill it in; if they rested all the time, leave the column out.",
        )
    steps = np.abs(np.diff(recording.magnet_mm))
    steps = steps[np.isfinite(steps)]
    jitter = float(np.median(steps)) if len(steps) else 0.0
    if jitter > 0:
        return RecordingError(
            f"no stretch of resting magnets lasts {choice.minimum_s:g} s "
            f"(the position changes by {jitter:.2g} mm from frame to frame)",
            mend="Raise [plateaus] tolerance_mm above the motor's noise, or lower minimum_s.",
        )
    longest = choice.model_copy(update={"minimum_s": 0.0, "settle_s": 0.0})
    every = find_plateaus(recording.time_s, recording.magnet_mm, longest)
    frame_s = float(np.median(np.diff(recording.time_s)))
    longest_s = frame_s * max((one.stop - one.start for one in every), default=1)
    empty = int(np.count_nonzero(np.isnan(recording.magnet_mm)))
    if empty:
        return RecordingError(
            f"the magnet position is missing in {empty} of {len(recording.magnet_mm)} frames, and "
            f"without a break it is there for at most {longest_s:.3g} s; a plateau needs "
            f"{choice.minimum_s:g} s",
            mend="Fill the empty cells of the magnet's column, or lower [plateaus] minimum_s.",
        )
    return RecordingError(
        f"no stretch of resting magnets is left that lasts {choice.minimum_s:g} s: the longest "
        f"lasts {longest_s:.3g} s, of which {choice.settle_s:g} s are left out for settling, and "
        "any time in which the magnets rotate",
        mend="Lower [plateaus] minimum_s or settle_s.",
    )


def _guesses(tables: list[OpenTable], source: Source | None) -> list[Notice]:
    said = dict.fromkeys(g for table in tables for g in table.guesses)
    notices = [Notice("guessed_layout", "info", f"{g[0].upper()}{g[1:]}.") for g in said]
    taken = dict.fromkeys(remark for table in tables for remark in table.remarks)
    notices += [Notice("file_incomplete", "caution", f"{remark}.") for remark in taken]
    if source is not None and source.beads and source.format is None:
        kind = "text" if isinstance(tables[0], TextTable) else kind_of(tables[0].path)
        notices.append(Notice("guessed_layout", "info", f"The file is taken for {_KINDS[kind]}."))
    return notices


def _remarks(data: Collected, positions: dict[str, np.ndarray]) -> list[Notice]:
    notices = []
    if data.zero_rows:
        said = f"{data.zero_rows} rows in which every position is 0 are taken as lost."
        notices.append(Notice("all_zero_rows", "info", said))
    if data.unused:
        said = f"Columns that are not used: {', '.join(data.unused[:12])}."
        notices.append(Notice("unused_columns", "info", said))
    misspelt = [name for name in data.unused if _is_magnet(name)] if data.magnet_mm is None else []
    if misspelt:
        said = (
            f"Column {misspelt[0]} is not used: the magnet position is read from a column "
            "magnet_mm, in mm. Without it the whole recording is taken as one plateau."
        )
        notices.append(Notice("magnet_not_used", "caution", said))
    for bead, count in data.infinite.items():
        said = f"{count} infinite positions of bead {bead} are taken as lost."
        notices.append(Notice("infinite", "caution", said, bead=bead))
    for axis, k in (("x", 0), ("y", 1), ("z", 2)):
        absent = [b for b, xyz in positions.items() if np.isnan(xyz[:, k]).all()]
        if absent:
            who = "any bead" if len(absent) == len(positions) else ", ".join(absent[:12])
            said = f"There is no {axis} of {who}."
            notices.append(Notice("no_axis", "info", said, axis=axis))
    return notices


def _is_magnet(name: str) -> bool:
    """Whether a column may be meant for `magnet_mm`."""
    plain = name.strip().casefold()
    return "magnet" in plain or bool(difflib.get_close_matches(plain, ["magnet_mm"], cutoff=0.75))


def _locator(tables: list[OpenTable], data: Collected, rows: RowChoice) -> Callable[[int], str]:
    def locate(row: int) -> str:
        k = int(np.searchsorted(data.starts, row, side="right")) - 1
        table, within = tables[k], row - data.starts[k] + 1
        if rows.keep or rows.skip:
            return f"{table.path}, row {within} of those kept"
        if isinstance(table, TextTable):
            return f"{table.path}, line {table.line_of(within - 1)}"
        return f"{table.path}, row {within}"

    return locate
