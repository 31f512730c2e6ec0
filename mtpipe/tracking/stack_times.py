"""When the frames of a stack were taken, as far as its files say.

In this order: OME's `DeltaT` of each plane or its `TimeIncrement`, MicroManager's
`ElapsedTime-ms`, the `DateTime` of each page if it has fractions of a second, ImageJ's frame
interval. (ImageJ's `fps` is the speed of its player, and is not used.) Stamps that are missing
for a frame, repeat or go backward are not used, and a notice says so.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice, Severity
from mtpipe.ingest.clock import read_clock
from mtpipe.ingest.collect import Collected
from mtpipe.ingest.column_attributes import PLACEHOLDER_HZ, RATE_TOLERANCE

if TYPE_CHECKING:
    from tifffile import TiffFile, TiffPage

    from mtpipe.ground.types import FloatArray

SECONDS = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3,
           "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}  # fmt: skip
MOST_FRAMES = 1e9  # no film has as many, and its times would fill the memory
MICROMANAGER_TAG, DATE_TAG = 51123, 306
DATE = re.compile(r"(\d{4})[:-]?(\d\d)[:-]?(\d\d)[ T](\d\d):(\d\d):(\d\d)([.,]\d+)?")


@dataclass(frozen=True)
class Stamps:
    """Time stamps in s, (n_frames,), and where they stand in the file, in words.

    With `interval_s` alone (`time_s` None) frames follow one another regularly.
    """

    source: str
    time_s: FloatArray | None
    interval_s: float | None = None

    @staticmethod
    def joined(
        pieces: Sequence[Stamps | None], frames: Sequence[int]
    ) -> tuple[Stamps | None, list[Notice]]:
        """Stamps of a series from those of its files, as far as they all have them.

        An OME film that is spread over files has the times of all its frames in the first.
        """
        first, total = pieces[0], sum(frames)
        if first is not None and first.time_s is not None and len(first.time_s) >= total:
            # a film that was stopped has times of fewer frames than its metadata plan
            pieces = [replace(first, time_s=first.time_s[:total])]
        known = [piece for piece in pieces if piece is not None]
        if not known:
            return None, []
        if len(known) < len(pieces) or len({p.source for p in known}) > 1:
            return None, [_unused(known[0].source, "not every file has them")]
        intervals = {p.interval_s for p in known}
        if None not in intervals:
            if len(intervals) > 1:
                return None, [_unused(known[0].source, "the files differ in them")]
            return known[0], []
        parts = [p.time_s for p in known if p.time_s is not None]
        if len(parts) < len(known):
            return None, [_unused(known[0].source, "not every file has them")]
        time_s = np.concatenate(parts)
        if len(time_s) != total:
            return None, [_unused(known[0].source, f"there are {len(time_s)} of {total} frames")]
        if not np.isfinite(time_s).all():
            missing = int(np.count_nonzero(~np.isfinite(time_s)))
            return None, [_unused(known[0].source, f"{missing} of {len(time_s)} are missing")]
        steps = np.diff(time_s)
        if len(steps) and steps.min() <= 0:
            at = int(np.argmax(steps <= 0)) + 2
            how = "repeat" if steps.min() == 0 else "go backward"
            return None, [_unused(known[0].source, f"they {how} (first at frame {at})")]
        return Stamps(known[0].source, time_s - time_s[0]), []


def _unused(source: str, why: str) -> Notice:
    said = f"The time stamps of the stack ({source}) are not used: {why}."
    return Notice("stamps_not_used", "caution", said)


def frame_times(
    stamps: Stamps | None, frames: int, stated_hz: float | None, *, put_aside: bool = False
) -> tuple[FloatArray, tuple[Notice, ...]]:
    """Start of each frame in s, (frames,), and which source it has.

    Parameters
    ----------
    stated_hz : the setup's frame rate; None where it is unknown.
    put_aside : the setup says that its rate is right and stamps are not.

    Raises
    ------
    RecordingError : stamps contradict the setup by more than 0.5 %, or neither states a rate.
    """
    unknown = stamps is not None and stamps.interval_s == 1 / PLACEHOLDER_HZ
    unknown &= stated_hz is None or abs(stated_hz / PLACEHOLDER_HZ - 1) > RATE_TOLERANCE
    if stamps is None or put_aside or unknown:
        told = "the stack has no time stamps"
        if stamps is not None:
            told = f'its stamps ({stamps.source}) are put aside by [tracking] times = "setup"'
            if not put_aside:
                told = (
                    f"{stamps.source} of 1 s, which programs write that do not know the time "
                    "between frames, is put aside"
                )
        if stated_hz is None:
            raise RecordingError(
                f"the frame rate is unknown, and {told}",
                mend="Give camera.frame_rate_hz in the setup.",
            )
        said = (
            f"{told[0].upper()}{told[1:]}: frames are taken to follow one another at "
            f"{stated_hz:g} Hz ([camera] frame_rate_hz); frames that the camera lost do not show."
        )
        severity: Severity = "caution" if unknown and not put_aside else "info"
        return np.arange(frames) / stated_hz, (Notice("times_from_setup", severity, said),)
    if stamps.time_s is not None:
        time_s = stamps.time_s
    else:
        assert stamps.interval_s is not None
        time_s = np.arange(frames) * np.float64(stamps.interval_s)
    columns = Collected({}, time_s, None, None, None, (0,), 0, {}, ())
    try:
        clock = read_clock(columns, None, stated_hz, lambda row: f"frame {row + 1}")
    except RecordingError as error:
        wrong = f"If its stamps are wrong ({stamps.source}), put them aside with"
        error.mend = f'{error.mend or ""} {wrong} [tracking] times = "setup".'.strip()
        raise
    said = f"Times of the frames are those of the stack ({stamps.source})."
    return clock.time_s, (Notice("times_from_stack", "info", said), *clock.notices)


def stamps_of_file(tif: TiffFile, frames: int) -> Stamps | None:
    """What a file as a whole says: OME's planes or increment, ImageJ's frame interval."""
    if tif.is_ome and tif.ome_metadata:
        return _of_ome(tif.ome_metadata, frames)
    if tif.is_imagej:
        told = tif.imagej_metadata or {}
        interval = told.get("finterval")
        unit = SECONDS.get(str(told.get("tunit", "s")).strip())
        if isinstance(interval, (int, float)) and interval > 0 and unit is not None:
            return Stamps("ImageJ's frame interval", None, float(interval) * unit)
    return None


def _of_ome(xml: str, frames: int) -> Stamps | None:
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError:
        return None
    space = root.tag.partition("}")[0] + "}" if root.tag.startswith("{") else ""
    pixels = root.find(f".//{space}Pixels")
    if pixels is None:
        return None
    # planes of the whole film, of which this file may hold a part
    announced = math.prod(_number(pixels.get(f"Size{axis}", "1")) for axis in "TZC")
    frames = int(announced) if frames < announced < MOST_FRAMES else frames
    time_s = np.full(frames, np.nan)
    for plane in pixels.iter(f"{space}Plane"):
        # one of them counts the frames
        k = max(_number(plane.get(f"The{axis}", "0")) for axis in "TZC")
        unit = SECONDS.get(plane.get("DeltaTUnit", "s"), np.nan)
        if 0 <= k < frames:
            time_s[int(k)] = _number(plane.get("DeltaT", "")) * unit
    if np.isfinite(time_s).any():
        return Stamps("OME DeltaT", time_s)
    increment = _number(pixels.get("TimeIncrement", ""))
    unit = SECONDS.get(pixels.get("TimeIncrementUnit", "s"), np.nan)
    if increment * unit > 0:
        return Stamps("OME TimeIncrement", None, increment * unit)
    return None


def _number(text: str) -> float:
    """A number in metadata; NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan


class StampsOfPages:
    """Collects the stamps that stand in the pages themselves."""

    def __init__(self, pages: int) -> None:
        self._elapsed = np.full(pages, np.nan)
        self._date = np.full(pages, np.nan)
        self._fractions = False

    def add(self, k: int, page: TiffPage) -> None:
        """Take the stamps of page k (from 0)."""
        told = page.tags.get(MICROMANAGER_TAG)
        if told is not None and isinstance(told.value, dict):
            elapsed = told.value.get("ElapsedTime-ms")
            if isinstance(elapsed, (int, float)):
                self._elapsed[k] = elapsed * 1e-3
        date = page.tags.get(DATE_TAG)
        match = DATE.match(str(date.value)) if date is not None else None
        if match is None:
            return
        try:
            whole = datetime(*(int(part) for part in match.groups()[:6]))  # type: ignore[arg-type]
        except ValueError:
            return
        fraction = float((match[7] or ".0").replace(",", "."))
        self._fractions |= fraction > 0
        self._date[k] = (whole - datetime(2000, 1, 1)).total_seconds() + fraction

    def found(self, frames: int) -> Stamps | None:
        """The stamps of the first pages, NaN where one has none; None where they have none."""
        if np.isfinite(self._elapsed[:frames]).any():
            return Stamps("MicroManager ElapsedTime-ms", self._elapsed[:frames])
        if self._fractions:  # whole seconds are no times of frames
            return Stamps("DateTime of the pages", self._date[:frames])
        return None
