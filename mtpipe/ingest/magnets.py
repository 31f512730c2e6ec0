"""Where the magnets are at each frame, and when they rotate.

A magnet log with its own clock is read as a small recording of its own and interpolated to the
frames; frames outside the log have no position and so no plateau.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from mtpipe.errors import RecordingError
from mtpipe.ingest.collect import Collected, OpenTable
from mtpipe.ingest.columns import Names
from mtpipe.ingest.source import (
    NM_PER_UNIT,
    SECONDS_PER_UNIT,
    TURNS_PER_UNIT,
    Layout,
    Rotation,
    Source,
)
from mtpipe.notice import Notice
from mtpipe.recording import FloatArray


@dataclass(frozen=True)
class Magnets:
    """Position and rotation at each frame, (n_frames,) or None, and where they are at rest."""

    position_mm: FloatArray | None
    resting: NDArray[np.bool_] | None
    notices: tuple[Notice, ...] = ()


def read_magnets(
    data: Collected,
    time_s: FloatArray,
    rate_hz: float,
    source: Source | None,
    files: Sequence[Path],
    folder: Path,
    open_table: Callable[[Path, Layout, tuple[str, ...]], OpenTable],
) -> Magnets:
    """Take the magnets' position and rotation from the recording or from their own log.

    Raises
    ------
    RecordingError : the log is missing, damaged, goes backward or does not overlap the recording.
    """
    position, turns = data.magnet_mm, data.turns
    notices: list[Notice] = []
    if source is not None and source.magnet is not None and source.magnet.time_column is not None:
        position, logged_turns, said = _from_log(source, time_s, files, folder, open_table)
        turns = turns if logged_turns is None else logged_turns
        notices += said
    if position is None:
        said_none = "There is no magnet position: the whole recording is taken as one plateau."
        notices.append(Notice("no_magnet", "info", said_none))
    rotation = source.rotation if source is not None else None
    if rotation is None or turns is None:
        return Magnets(position, None, tuple(notices))
    resting = ~rotating(turns, rate_hz, rotation)
    away = len(resting) - int(np.count_nonzero(resting))
    if away:
        said_away = f"The magnets rotate during {away / rate_hz:.3g} s: no plateau there."
        notices.append(Notice("rotation", "info", said_away))
    return Magnets(position, resting, tuple(notices))


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
    time_s: FloatArray,
    files: Sequence[Path],
    folder: Path,
    open_table: Callable[[Path, Layout, tuple[str, ...]], OpenTable],
) -> tuple[FloatArray, FloatArray | None, list[Notice]]:
    magnet, rotation = source.magnet, source.rotation
    assert magnet is not None
    assert magnet.time_column is not None
    if magnet.file is not None:
        paths, layout = [folder / magnet.file], Layout.model_validate(_layout_of(magnet))
    else:
        paths, layout = list(files), Layout.model_validate(_layout_of(source))
    if not paths[0].exists():
        raise RecordingError("there is no such magnet log", where=str(paths[0]))
    pieces: list[list[FloatArray]] = []
    guesses: tuple[str, ...] = ()
    for path in paths:
        table = open_table(path, layout, source.lost.tokens)
        guesses = table.guesses
        names = Names(table.names, table.has_names, str(path))
        wanted = [names.find(magnet.time_column, "log time"), names.find(magnet.column, "magnet")]
        if rotation is not None and rotation.in_log:
            wanted.append(names.find(rotation.column, "rotation"))
        pieces += table.batches(wanted)
    if not pieces:
        raise RecordingError("the magnet log has no rows", where=str(paths[0]))
    columns = [np.concatenate(column) for column in zip(*pieces, strict=True)]
    known = np.isfinite(columns[0]) & np.isfinite(columns[1])
    clock, value = columns[0][known], columns[1][known]
    clock = clock * SECONDS_PER_UNIT[magnet.time_unit] + magnet.clock_offset_s
    back = np.flatnonzero(np.diff(clock) < 0)
    if len(back):
        raise RecordingError(
            f"the magnet log's time goes backward after its row {int(back[0]) + 1}",
            where=str(paths[0]),
        )
    if len(clock) == 0 or clock[-1] < time_s[0] or clock[0] > time_s[-1]:
        span = f"{clock[0]:.6g} to {clock[-1]:.6g} s" if len(clock) else "nothing"
        raise RecordingError(
            f"the magnet log covers {span}, the recording {time_s[0]:.6g} to {time_s[-1]:.6g} s",
            where=str(paths[0]),
            mend="Check [source.magnet] time_unit and clock_offset_s.",
        )
    millimetres = value * (magnet.scale * NM_PER_UNIT[magnet.unit] / 1e6) + magnet.offset_mm
    position = np.interp(time_s, clock, millimetres, left=np.nan, right=np.nan)
    notices = [Notice("guessed_layout", "info", f"{paths[0].name}: {g}.") for g in guesses]
    outside = int(np.count_nonzero(np.isnan(position)))
    if outside:
        said = f"{outside} frames lie outside the magnet log and belong to no plateau."
        notices.append(Notice("outside_log", "caution", said))
    turns = None
    if rotation is not None and rotation.in_log:
        angle = columns[2][known] * TURNS_PER_UNIT[rotation.unit]
        turns = np.interp(time_s, clock, angle, left=np.nan, right=np.nan)
    return position, turns, notices


def _layout_of(table: Layout) -> dict[str, object]:
    return {name: getattr(table, name) for name in Layout.model_fields}
