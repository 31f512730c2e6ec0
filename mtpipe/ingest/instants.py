"""Clock times (instants): dates with times of day, and times of day alone, of any usual writing.

They are kept as whole nanoseconds (datetime64[ns], UTC where a time zone is written), and only
differences of them become floating-point seconds. Minutes and seconds without an hour, as
spreadsheets write times (`59:58.5`), are known by their fraction; they count from `HOURLESS`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

MONTHS = "janfebmaraprmayjunjulaugsepoctnovdec"
NAME = rf"(?P<{{}}>(?:{'|'.join(MONTHS[k : k + 3] for k in range(0, 36, 3))})[a-z]*)\.?"
DATES = (
    r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})",
    r"(?P<compact>\d{8})",
    r"(?P<a>\d{1,2})[-/.](?P<b>\d{1,2})[-/.](?P<c>\d{4}|\d{2})",
    rf"(?P<day_first>\d{{1,2}})[-/. ]*{NAME.format('its_month')}[-/., ]+(?P<its_year>\d{{4}})",
    rf"{NAME.format('month_first')} +(?P<its_day>\d{{1,2}}),? +(?P<last_year>\d{{4}})",
)
PART = r"(?:[.,:](?P<part>\d{1,9})\d*)?"
TIME = (
    r"(?P<hour>[01]?\d|2[0-4]):(?P<minute>[0-5]\d)(?::(?P<second>[0-6]\d)"
    rf"{PART})?(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
)
# Of file names, behind a date alone: 2024-05-01_12-00-00.008, 20240501T120000.008
PLAIN_TIME = rf"(?P<hour>[01]\d|2[0-4])-?(?P<minute>[0-5]\d)-?(?P<second>[0-6]\d){PART}"
ZONE = (
    r"(?:\s*(?:(?P<zone>Z|UTC|GMT|[+-]\d{2}:?\d{2}|[+-]\d{2})|\s(?P<zone_name>(?-i:[A-Z]{3,5}))))?"
)
DATE = rf"(?:{'|'.join(DATES)})(?:\s*[T ,;_]\s*|\s+)"
WAYS = [
    re.compile(rf"\s*{way}{ZONE}\s*", re.IGNORECASE)
    for way in (rf"(?:{DATE})?{TIME}", rf"{DATE}{PLAIN_TIME}")
]
# A fraction behind a colon has at least three digits; two would be seconds.
MINUTES = re.compile(
    r"\s*(?P<minute>\d{1,4}):(?P<second>[0-5]\d)(?:[.,]|:(?=\d{3}))(?P<part>\d+)\s*"
)
WHOLE_SECONDS = re.compile(r"\s*(?P<minute>\d{1,4}):(?P<second>[0-5]\d)\s*")
HOURLESS = np.datetime64("1960-01-01", "ns")
HOUR_NS, DAY_NS = 3600 * 10**9, 86_400 * 10**9


def is_instant(text: str) -> bool:
    """Whether a cell is a clock time, such as `2024-05-01T12:00:00.008+02:00` or `12:00:00.008`."""
    return MINUTES.fullmatch(text) is not None or _parts(text) is not None


def are_instants(cells: Sequence[str]) -> bool:
    """Whether the cells that are not empty, of which there is one at least, are clock times.

    They are none where the name of the time zone changes, as hours then do.
    """
    written = [cell for cell in cells if cell.strip()]
    if any(MINUTES.fullmatch(cell) for cell in written):
        written = [cell for cell in written if _since_the_hour(cell) is None] or ["00:00"]
    parts = [_parts(cell) for cell in written]
    known = [part for part in parts if part is not None]
    zones = {part.get("zone_name") for part in known}
    return bool(parts) and len(known) == len(parts) and len(zones) == 1


def _parts(text: str) -> dict[str, str | None] | None:
    """The parts of a clock time, None of other text."""
    return next((m.groupdict() for way in WAYS if (m := way.fullmatch(text))), None)


def instants_of(cells: Sequence[str]) -> NDArray[Any]:
    """Clock times (n,) datetime64[ns], NaT for what is none.

    Times of day count from 1970-01-01, without an hour from `HOURLESS`. Of `03/05/2024` the first
    number is the month, of `03.05.2024` the day.
    """
    iso = pd.to_datetime(pd.Series(list(cells), dtype=object), format="ISO8601", utc=True,
                         errors="coerce")  # fmt: skip
    values = np.array(iso.dt.tz_localize(None), dtype="datetime64[ns]")
    hourless = any(MINUTES.fullmatch(cell) for cell in cells)
    for row in np.flatnonzero(np.isnat(values)).tolist():
        minutes = _since_the_hour(cells[row]) if hourless else None
        values[row] = _instant(cells[row]) if minutes is None else minutes
    return values


def _since_the_hour(text: str) -> np.datetime64 | None:
    """Minutes and seconds; None of other text."""
    part = MINUTES.fullmatch(text) or WHOLE_SECONDS.fullmatch(text)
    if part is None:
        return None
    seconds = 60 * int(part["minute"]) + int(part["second"])
    return HOURLESS + np.timedelta64(
        seconds * 10**9 + _nanoseconds(part.groupdict().get("part")), "ns"
    )


def _nanoseconds(part: str | None) -> int:
    return int((part or "0")[:9].ljust(9, "0"))


def _date(text: str, part: dict[str, str | None]) -> tuple[int, int, int]:
    """Year, month and day; those of 1970-01-01 without."""
    compact = part["compact"] or ""
    year = part["year"] or compact[:4] or part["c"] or part["its_year"] or part["last_year"]
    name = part["its_month"] or part["month_first"]
    month = part["month"] or compact[4:6] or part["b"]
    day = part["day"] or compact[6:] or part["a"] or part["day_first"] or part["its_day"]
    if part["c"] and "/" in text and int(part["a"] or 0) <= 12:
        month, day = day, month
    in_number = MONTHS.index(name[:3].casefold()) // 3 + 1 if name else int(month or 1)
    century = 2000 if year and len(year) == 2 else 0
    return int(year or 1970) + century, in_number, int(day or 1)


def _instant(text: str) -> np.datetime64:
    part = _parts(text)
    if part is None:
        return np.datetime64("NaT", "ns")
    year, month, day = _date(text, part)
    hour, half = int(part["hour"] or 0), (part.get("half") or "").lower()
    if half:
        hour = hour % 12 + 12 * (half == "p")
    try:
        date = np.datetime64(f"{year:04}-{month:02}-{day:02}")
    except ValueError:
        return np.datetime64("NaT", "ns")
    seconds = 3600 * hour + 60 * int(part["minute"] or 0) + int(part["second"] or 0)
    seconds -= _zone_s(part["zone"] or "")
    nanoseconds = seconds * 10**9 + _nanoseconds(part["part"])
    return np.datetime64(str(date), "ns") + np.timedelta64(nanoseconds, "ns")


def _zone_s(zone: str) -> int:
    digits = re.sub(r"\D", "", zone)
    if not digits:
        return 0
    seconds = 3600 * int(digits[:2]) + 60 * int(digits[2:] or 0)
    return -seconds if zone.startswith("-") else seconds


def since(
    first: np.datetime64 | None, moments: NDArray[Any], before_s: float | None = None
) -> NDArray[np.float64]:
    """Seconds (n,) since a clock time, NaN where there is none; exact to a nanosecond.

    Times of day that begin anew at midnight go on, and minutes that begin anew at the full hour.

    Parameters
    ----------
    moments : (n,) in order. before_s : seconds of the last one before them; without, the first of
        them is within half a day, or half an hour, of `first`.
    """
    passed = np.full(len(moments), np.nan)
    known = np.flatnonzero(~np.isnat(moments))
    if first is None or not len(known):
        return passed
    there = moments[known]
    period = 0
    if first < np.datetime64(1, "D"):  # a time of day: only these are before
        period = DAY_NS
        if first < np.datetime64(0, "D"):
            period = HOUR_NS
            # 1:00:00.5 that follows 59:59.5
            there = np.where(
                there < np.datetime64(0, "D"), there, HOURLESS + there.astype(np.int64)
            )
    whole = (there - first).astype(np.int64)
    if period:
        if before_s is None:
            anew = -round(whole[0] / period)
        else:
            anew = max(0, -((whole[0] - round(before_s * 1e9) + period // 2) // period))
        back = np.diff(whole, prepend=whole[:1]) < -period // 2
        whole = whole + period * (anew + np.cumsum(back))
    passed[known] = whole / 1e9
    return passed
