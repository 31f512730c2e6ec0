"""Where the magnets are at each frame, and when they rotate.

A magnet log with its own clock is read as a small recording of its own and interpolated to the
frames; frames outside the log have no position and so no plateau. A log without a clock has a row
for every row of the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.agreement import Use, check_uses
from mtpipe.ingest.collect import Collected, OpenTable, RowChoice
from mtpipe.ingest.columns import Names
from mtpipe.ingest.instants import since
from mtpipe.setup.source_parts import NM_PER_UNIT, SECONDS_PER_UNIT, TURNS_PER_UNIT, Layout
from mtpipe.setup.source_signals import Rotation
from mtpipe.setup.source_table import Source


@dataclass(frozen=True)
class Magnets:
    """Position and turns at each frame, (n_frames,) or None, and where they do not rotate."""

    position_mm: FloatArray | None
    turns: FloatArray | None
    resting: NDArray[np.bool_] | None
    notices: tuple[Notice, ...] = ()


def read_magnets(
    data: Collected,
    time_s: FloatArray,
    rate_hz: float,
    source: Source | None,
    files: Sequence[Path],
    folder: Path,
    open_table: Callable[[Path, Layout, tuple[str, ...], tuple[str, ...]], OpenTable],
) -> Magnets:
    """Take the magnets' position and rotation from the recording or from their own log.

    Raises
    ------
    RecordingError : the log is missing, damaged, goes backward, does not overlap the recording,
        or has not a row for each of its rows.
    """
    position, turns = data.magnet_mm, data.turns
    notices: list[Notice] = []
    if source is not None and source.magnet is not None and source.magnet.is_log:
        position, logged_turns, said = _from_log(
            source, data.began, time_s, files, folder, open_table
        )
        turns = turns if logged_turns is None else logged_turns
        notices += said
    notices += _missing(position, data, rate_hz)
    if position is None:
        said_none = "There is no magnet position: the whole recording is taken as one plateau."
        notices.append(Notice("no_magnet", "info", said_none))
    if turns is None:
        return Magnets(position, None, None, tuple(notices))
    stated = source.rotation if source is not None else None
    rotation = stated or Rotation(column="magnet_turns", unit="turn")
    resting = ~rotating(turns, rate_hz, rotation)
    away = len(resting) - int(np.count_nonzero(resting))
    if away:
        said_away = f"The magnets rotate during {away / rate_hz:.3g} s: no plateau there."
        notices.append(Notice("rotation", "info", said_away))
    return Magnets(position, turns, resting, tuple(notices))


def _missing(position: FloatArray | None, data: Collected, rate_hz: float) -> list[Notice]:
    """Say where beads were seen and nothing was written of the magnets."""
    if position is None or position is not data.magnet_mm or np.isfinite(position).all():
        return []
    seen = np.zeros(len(position), dtype=np.bool_)
    for xyz in data.positions_nm.values():
        seen |= np.isfinite(xyz).any(axis=1)
    empty = int(np.count_nonzero(seen & np.isnan(position)))
    if not empty:
        return []
    said = (
        f"The magnet position is missing in {empty} of {len(position)} frames "
        f"({empty / rate_hz:.3g} s): they belong to no plateau, and a plateau ends there."
    )
    return [Notice("magnet_missing", "caution", said)]


def rotating(turns: FloatArray, rate_hz: float, rotation: Rotation) -> NDArray[np.bool_]:
    """Whether the angle changes within a window about each frame by more than the tolerance.

    Parameters
    ----------
    turns : (n_frames,); NaN is no rotation.

    Returns
    -------
    (n_frames,) bool
    """
    width = max(2, round(rotation.window_s * rate_hz)) + 1
    high = maximum_filter1d(np.where(np.isfinite(turns), turns, -np.inf), width)
    low = minimum_filter1d(np.where(np.isfinite(turns), turns, np.inf), width)
    return np.asarray(high - low > rotation.tolerance_turns)


def _from_log(
    source: Source,
    began: np.datetime64 | None,
    time_s: FloatArray,
    files: Sequence[Path],
    folder: Path,
    open_table: Callable[[Path, Layout, tuple[str, ...], tuple[str, ...]], OpenTable],
) -> tuple[FloatArray, FloatArray | None, list[Notice]]:
    magnet, rotation = source.magnet, source.rotation
    assert magnet is not None
    turned = rotation if rotation is not None and rotation.in_log else None
    paths = magnet.logs(files, folder)
    layout = Layout.model_validate(_layout_of(magnet if magnet.file is not None else source))
    wanted = [(magnet.column, "magnet")]
    wanted += [(turned.column, "rotation")] if turned is not None else []
    wanted += [(magnet.time_column, "log time")] if magnet.time_column is not None else []
    units = [magnet.unit, *([turned.unit] if turned is not None else []), magnet.time_unit]
    pieces: list[list[NDArray[Any]]] = []
    notices: list[Notice] = []
    for path in paths:
        if not path.exists():
            mend = "Correct [source.magnet] file" + (
                ", or write magnet = false if the magnets rested all the time."
                if source.preset is not None
                else "."
            )
            raise RecordingError("there is no such magnet log", where=str(path), mend=mend)
        asked = tuple(column for column, _ in wanted if isinstance(column, str))
        table = open_table(path, layout, source.lost.tokens, asked)
        names = Names(table.names, table.has_names, str(path), table.unusable)
        found = [names.find(column, what) for column, what in wanted]
        uses = [
            Use(column, what, unit, "[source.magnet] and [source.rotation]")
            for column, (_, what), unit in zip(found, wanted, units, strict=False)
        ]
        told, contradictions = check_uses(table, uses, aside=layout.attributes is not None)
        if contradictions:  # nothing else tells the magnets' unit
            raise contradictions[0].refused()
        notices += told
        pieces += table.batches(found)
        notices += [Notice("guessed_layout", "info", f"{path.name}: {g}.") for g in table.guesses]
        notices += [Notice("file_incomplete", "caution", f"{r}.") for r in table.remarks]
    if not pieces:
        raise RecordingError("the magnet log has no rows", where=str(paths[0]))
    columns = [np.concatenate(column) for column in zip(*pieces, strict=True)]
    columns[0] = columns[0] * (magnet.scale * NM_PER_UNIT[magnet.unit] / 1e6) + magnet.offset_mm
    if turned is not None:
        columns[1] = columns[1] * TURNS_PER_UNIT[turned.unit]
    where = str(paths[0])
    if magnet.row_by_row:
        at_frames = _row_by_row(columns, len(time_s), source, where)
    else:
        clock = columns.pop()
        if clock.dtype.kind == "M":
            if began is None:
                said = (
                    f"{paths[0].name} has times of day, the recording has none: the log's first "
                    f"entry is taken to be at {magnet.clock_offset_s:g} s of the recording."
                )
                notices.append(Notice("log_clock", "caution", said))
            clock = since(clock[0] if began is None else began, clock)
        else:
            clock = clock * SECONDS_PER_UNIT[magnet.time_unit]
        clock = clock + magnet.clock_offset_s
        at_frames = _interpolated(columns, clock, time_s, where)
        outside = int(np.count_nonzero(np.isnan(at_frames[0])))
        if outside:
            said = f"{outside} frames lie outside the magnet log and belong to no plateau."
            notices.append(Notice("outside_log", "caution", said))
    turns = at_frames[1] if turned is not None else None
    return at_frames[0], turns, list(dict.fromkeys(notices))


def _row_by_row(
    columns: list[FloatArray], frames: int, source: Source, where: str
) -> list[FloatArray]:
    """Columns of a log that has a row for every row of the files, at the rows that are kept."""
    mask = RowChoice(source.keep_rows, source.skip_rows).mask(0, len(columns[0]))
    kept = columns if mask is None else [column[mask] for column in columns]
    if len(kept[0]) != frames:
        raise RecordingError(
            f"has {len(kept[0])} rows where the recording has {frames}; a magnet log without a "
            "clock needs a row for each",
            where=where,
        )
    return kept


def _interpolated(
    columns: list[FloatArray], clock: FloatArray, time_s: FloatArray, where: str
) -> list[FloatArray]:
    """Columns of a log with a clock of its own at the times of the frames, NaN outside the log."""
    known = np.isfinite(clock) & np.isfinite(columns[0])
    clock = clock[known]
    back = np.flatnonzero(np.diff(clock) < 0)
    if len(back):
        raise RecordingError(
            f"the magnet log's time goes backward after its row {int(back[0]) + 1}", where=where
        )
    if len(clock) == 0 or clock[-1] < time_s[0] or clock[0] > time_s[-1]:
        span = f"{clock[0]:.6g} to {clock[-1]:.6g} s" if len(clock) else "nothing"
        raise RecordingError(
            f"the magnet log covers {span}, the recording {time_s[0]:.6g} to {time_s[-1]:.6g} s",
            where=where,
            mend="Check [source.magnet] time_unit and clock_offset_s.",
        )
    return [np.interp(time_s, clock, c[known], left=np.nan, right=np.nan) for c in columns]


def _layout_of(table: Layout) -> dict[str, object]:
    return {name: getattr(table, name) for name in Layout.model_fields}
