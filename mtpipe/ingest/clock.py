"""The camera's clock: frame numbers on a regular grid, times, and the frame rate.

A frame that the camera lost leaves a jump in the frame numbers, and never shortens the time.
The rate is the slope of frame numbers over time stamps: the median of the differences misleads by
percents when stamps are rounded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.collect import Collected
from mtpipe.ingest.column_attributes import RATE_TOLERANCE
from mtpipe.setup.source_table import Source

# Recordings of beads have more frames than one per second, and no camera a million.
SLOWEST_HZ, FASTEST_HZ = 1.0, 1e6
# A unit other than s makes the rate wrong by a power of 1000; it is known within a factor of two.
WRONG_UNITS = {1e-3: "ms", 1e-6: "µs", 1e-9: "ns"}
UNIT_FACTOR = 2.0
JITTER_FRAMES = 0.1
LONG_GAP_FRAMES = 20
CATCH_UP_ROWS = 20
MOST_FRAMES = 2.0**53  # beyond, doubles no longer count by ones
LATEST_S = 1e12
BLOCK_ROWS = 1 << 20
FEWEST_STAMPS = 10


@dataclass(frozen=True)
class Clock:
    """Times and frame numbers, (n_frames,) each, and the frame rate that they have."""

    time_s: FloatArray
    frame: NDArray[np.int64]
    rate_hz: float
    notices: tuple[Notice, ...]


def read_clock(
    data: Collected, source: Source | None, stated_hz: float | None, locate: Callable[[int], str]
) -> Clock:
    """Number the frames.

    Parameters
    ----------
    stated_hz : the setup's frame rate, None where it is unknown.
    locate : file and line of a row (from 0), for messages.

    Raises
    ------
    RecordingError : stamps or numbers that repeat, go backward or are missing, a frame rate that
        contradicts them by more than 0.5 %, stamps in another unit, or no frame rate at all.
    """
    if data.frame is not None:
        return _from_frames(data, source, stated_hz, locate)
    if data.time_s is not None:
        return _from_stamps(data, data.time_s, source, stated_hz, locate)
    rate = _needed(stated_hz)
    n = len(next(iter(data.positions_nm.values())))
    frame = np.arange(n, dtype=np.int64)
    said = f"no time column: every row is taken for the next frame at {rate:g} Hz"
    if len(data.starts) > 1:
        said += f"; gaps between the {len(data.starts)} files would not show"
    return Clock(frame / rate, frame, rate, (Notice("rows_are_frames", "info", said + "."),))


def _from_frames(
    data: Collected, source: Source | None, stated_hz: float | None, locate: Callable[[int], str]
) -> Clock:
    assert data.frame is not None
    numbers = data.frame
    bad = np.flatnonzero(~(np.abs(numbers) < MOST_FRAMES) | (numbers != np.rint(numbers)))
    if len(bad):
        raise RecordingError(
            f"the frame number {numbers[bad[0]]:g} is no whole number",
            where=locate(int(bad[0])),
        )
    notices: list[Notice] = []
    column = _time_column(source)
    if source is not None and source.frame is not None and source.frame.restarts:
        numbers = _continued(numbers, data.starts, 1.0)
        notices.append(_restarted(len(data.starts)))
    frame = numbers.astype(np.int64)
    other = (
        "leave out [source] frame (frame = false beside a preset)"
        if source is not None and source.beads
        else "put time stamps, in a column time_s, in place of them"
    )
    _increasing(frame, "frame number", locate, f"the numbers count no frames, {other}")
    stamps = data.time_s
    missing = 0 if stamps is None else int(np.count_nonzero(~(np.abs(stamps) < LATEST_S)))
    if stamps is None or missing:
        rate = _needed(stated_hz)
        if missing:
            said = (
                f"{missing} of {len(frame)} time stamps are missing, so none is used: times are "
                f"frame numbers at {rate:g} Hz."
            )
            notices.append(Notice("stamps_not_used", "caution", said))
        return Clock(frame / rate, frame, rate, tuple(notices))
    coarse = f"the stamps are only rounded, {_for_rounded(source)}"
    _increasing(stamps, "time", locate, coarse, repeats=source is not None and _rounded(source))
    rate = _slope(frame, stamps) if len(frame) > 1 else 0.0
    rate = _agreed(rate, stated_hz, stamps, column, notices)
    return Clock(stamps, frame, rate, tuple(notices))


def _from_stamps(
    data: Collected,
    stamps: FloatArray,
    source: Source | None,
    stated_hz: float | None,
    locate: Callable[[int], str],
) -> Clock:
    missing = np.flatnonzero(~(np.abs(stamps) < LATEST_S))
    if len(missing):
        raise RecordingError(
            f"{len(missing)} of {len(stamps)} time stamps are missing or infinite",
            where=locate(int(missing[0])),
            mend=f"Leave those rows out ([source] skip_rows), or {_without_stamps(source)}.",
        )
    notices: list[Notice] = []
    if source is not None and source.time is not None and source.time.restarts:
        stamps = _continued(stamps, data.starts, 1 / _needed(stated_hz))
        notices.append(_restarted(len(data.starts)))
    rounded = source is not None and _rounded(source)
    coarse = f"the stamps are only rounded, {_for_rounded(source)}"
    _increasing(stamps, "time", locate, coarse, repeats=rounded)
    n = len(stamps)
    if n < 2:
        return Clock(stamps, np.zeros(n, dtype=np.int64), _needed(stated_hz), tuple(notices))
    if rounded:
        derived = (n - 1) / (stamps[-1] - stamps[0]) if stamps[-1] > stamps[0] else 0.0
    else:
        derived = _rate(stamps)
    rate = _agreed(float(derived), stated_hz, stamps, _time_column(source), notices)
    frame = np.arange(n, dtype=np.int64) if rounded else frames_of(stamps, rate)
    notices += _irregular(stamps, frame, rate, rounded)
    time_s = stamps[0] + frame / rate if rounded else stamps
    return Clock(time_s, frame, rate, tuple(notices))


def frames_of(stamps: FloatArray, rate_hz: float) -> NDArray[np.int64]:
    """Number frames by their time stamps, from 0.

    A stamp later than the next frame's is a lost frame only if the following stamps are late as
    well; if they catch up, the computer was late and not the camera. The rate may be wrong by
    some percents.

    Parameters
    ----------
    stamps : (n_frames,) increasing.
    """
    n = len(stamps)
    late = stamps * rate_hz  # by how many frames, but for a constant
    late -= late[0]
    late -= np.arange(n)
    lost: dict[int, int] = {}
    begin = 0
    for row in np.flatnonzero(np.diff(late) > 0.5) + 1:
        before = float(np.min(late[max(begin, row - CATCH_UP_ROWS) : row]))
        after = float(np.min(late[row : row + CATCH_UP_ROWS]))
        missing = round(min(after - before, MOST_FRAMES))
        if missing > 0:
            lost[int(row)] = missing
            begin = int(row)
    frame = np.arange(n, dtype=np.int64)
    if lost:
        skipped = np.zeros(n, dtype=np.int64)
        skipped[list(lost)] = list(lost.values())
        frame += np.cumsum(skipped)
    return frame


def _rate(stamps: FloatArray) -> float:
    """Frames per second over all but long gaps, whose number of frames hangs on the rate."""
    rate = 1 / float(np.median(np.diff(stamps)))
    for _ in range(2):
        frame = frames_of(stamps, rate)
        gaps = np.flatnonzero(np.diff(frame) > LONG_GAP_FRAMES) + 1
        rate = _slope(frame, stamps, gaps)
    return rate


def _slope(
    frame: NDArray[np.int64], stamps: FloatArray, gaps: Sequence[int] | NDArray[np.int64] = ()
) -> float:
    """Frames per second by least squares, each stretch between `gaps` with its own start.

    The ends alone would carry all of their stamps' error: seconds since 1970 are kept to 0.1 µs.
    """
    numbers, times = 0.0, 0.0
    for piece in np.split(np.arange(len(frame)), gaps):
        count = frame[piece] - np.mean(frame[piece])
        numbers += float(count @ count)
        times += float(count @ (stamps[piece] - stamps[piece[0]]))
    if not times:  # gaps between all rows
        return float((frame[-1] - frame[0]) / (stamps[-1] - stamps[0]))
    return numbers / times


def _without_stamps(source: Source | None) -> str:
    """What to do with a file whose stamps are of no use."""
    if source is None or not source.beads:
        return "put a column frame, with the number of each frame, in place of time_s"
    return "describe the file without its time column"


def _for_rounded(source: Source | None) -> str:
    """What to do with stamps so coarse that neighbours are equal."""
    if source is None or not source.beads:
        return _without_stamps(source)
    return "describe the time column in [source.time] with rounded = true"


def _rounded(source: Source) -> bool:
    return source.time is not None and source.time.rounded


def _needed(stated_hz: float | None) -> float:
    if stated_hz is None:
        raise RecordingError(
            "the frame rate is unknown, and the recording has no time stamps to take it from",
            mend="Give camera.frame_rate_hz in the setup.",
        )
    return stated_hz


def _time_column(source: Source | None) -> tuple[str, str, str]:
    """What the column of time stamps is called, the unit it should have, how that is mended."""
    if source is None or source.time is None:
        return "time_s", "s", "Write time_s in s."
    return f"column {source.time.column}", source.time.unit, "Correct unit in [source.time]."


def _agreed(
    derived_hz: float,
    stated_hz: float | None,
    stamps: FloatArray,
    column: tuple[str, str, str],
    notices: list[Notice],
) -> float:
    """The rate to go on with; notes one that was derived, refuses one that cannot be."""
    n = len(stamps)
    name, unit, mend = column
    if stated_hz is None:
        if n < FEWEST_STAMPS:
            return _needed(None)
        if not SLOWEST_HZ <= derived_hz <= FASTEST_HZ:
            few = derived_hz < SLOWEST_HZ
            perhaps = ", perhaps in ms or µs" if few and unit == "s" else ""
            raise RecordingError(
                f"by its time stamps the recording has {derived_hz:.3g} frames per second, which "
                f"are too {'few' if few else 'many'}: {name} seems not to be in {unit}{perhaps}",
                mend=f"{mend} If the stamps are right, give camera.frame_rate_hz.",
            )
        notices.append(
            Notice(
                "frame_rate_derived",
                "info",
                f"The frame rate, {derived_hz:.6g} Hz, was taken from the time stamps "
                f"({n} frames in {stamps[-1] - stamps[0]:.6g} s).",
            )
        )
        return derived_hz
    ratio = derived_hz / stated_hz
    if n < FEWEST_STAMPS or abs(ratio - 1) <= RATE_TOLERANCE:
        return stated_hz
    said = f"the setup says {stated_hz:g} frames per second, the time stamps say {derived_hz:.6g}"
    for factor, seconds in WRONG_UNITS.items():
        if 1 / UNIT_FACTOR < ratio / factor < UNIT_FACTOR:
            perhaps = f" but in {seconds}" if unit == "s" else ""
            raise RecordingError(f"{said}: {name} seems not to be in {unit}{perhaps}", mend=mend)
    near = 1 / UNIT_FACTOR < ratio < UNIT_FACTOR
    raise RecordingError(
        f"{said} ({f'{100 * (ratio - 1):+.3g} %' if near else f'{ratio:.4g} times that'})",
        mend='Correct camera.frame_rate_hz (or write "unknown" to use the stamps).',
    )


def _increasing(
    values: FloatArray | NDArray[np.int64],
    what: str,
    locate: Callable[[int], str],
    otherwise: str,
    repeats: bool = False,
) -> None:
    back = np.flatnonzero(values[1:] < values[:-1])
    if len(back):
        row = int(back[0]) + 1
        raise RecordingError(
            f"the {what} goes backward, from {values[row - 1]:.10g} to {values[row]:.10g}",
            where=locate(row),
            mend="Put the rows in order, or leave out those that are wrong ([source] skip_rows).",
        )
    same = np.flatnonzero(values[1:] == values[:-1])
    if len(same) and not repeats:
        row = int(same[0]) + 1
        more = f" ({len(same)} such rows)" if len(same) > 1 else ""
        raise RecordingError(
            f"the {what} {values[row]:.10g} occurs twice{more}",
            where=locate(row),
            mend=f"Leave out the row that is double; if {otherwise}.",
        )


def _irregular(
    stamps: FloatArray, frame: NDArray[np.int64], rate_hz: float, rounded: bool
) -> list[Notice]:
    """Says how far stamps lie from the regular grid of the frames."""
    if len(stamps) < FEWEST_STAMPS:
        return []
    if rounded:
        away = (stamps - stamps[0]) * rate_hz - frame
        worst = float(np.max(np.abs(away)))
        coarse = float(np.max(np.diff(stamps))) * rate_hz
        if worst <= 1 + coarse:
            return []
        said = (
            f"The rounded time stamps depart from a regular grid by up to {worst:.3g} frames; "
            "frames may be missing."
        )
        return [Notice("irregular_stamps", "warning", said)]
    square = 0.0
    for start in range(0, len(stamps) - 1, BLOCK_ROWS):
        piece = slice(start, start + BLOCK_ROWS + 1)
        away = np.diff(stamps[piece]) * rate_hz - np.diff(frame[piece])
        square += float(away @ away)
    jitter = math.sqrt(square / (len(stamps) - 1))
    if jitter <= JITTER_FRAMES:
        return []
    said = (
        f"Time stamps are irregular: their spacing scatters by {100 * jitter:.3g} % of a frame "
        "about the camera's grid. Frames are taken to be regular."
    )
    return [Notice("irregular_stamps", "caution", said)]


def _continued(values: FloatArray, starts: tuple[int, ...], step: float) -> FloatArray:
    """Values that begin anew in each file, carried on from file to file."""
    joined = values.copy()
    for start in starts[1:]:
        if 0 < start < len(joined):
            joined[start:] += joined[start - 1] + step - joined[start]
    return joined


def _restarted(files: int) -> Notice:
    said = f"The clock starts again in each of {files} files; gaps between them do not show."
    return Notice("clock_restarts", "info", said)
