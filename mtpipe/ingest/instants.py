"""Clock times (instants): dates with times of day, and times of day alone, of any usual writing.

They are kept as whole nanoseconds (datetime64[ns], UTC where a time zone is written), and only
differences of them become floating-point seconds.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

DATE_FIRST = r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})"
DATE_LAST = r"(?P<a>\d{1,2})[-/.](?P<b>\d{1,2})[-/.](?P<c>\d{4})"
TIME = (
    r"(?P<hour>[01]?\d|2[0-4]):(?P<minute>[0-5]\d)(?::(?P<second>[0-6]\d)(?:[.,:](?P<part>\d{1,9})\d*)?)?"
    r"(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
)
ZONE = r"(?:\s*(?P<zone>Z|UTC|GMT|[+-]\d{2}:?\d{2}|[+-]\d{2}))?"
INSTANT = re.compile(
    rf"\s*(?:(?:{DATE_FIRST}|{DATE_LAST})(?:\s*[T ,;_]\s*|\s+))?{TIME}{ZONE}\s*", re.IGNORECASE
)
DAY_NS = 86_400 * 10**9


def is_instant(text: str) -> bool:
    """Whether a cell is a clock time, such as `2024-05-01T12:00:00.008+02:00` or `12:00:00.008`."""
    return INSTANT.fullmatch(text) is not None


def are_instants(cells: Sequence[str]) -> bool:
    """Whether the cells that are not empty, of which there is one at least, are clock times."""
    filled = [cell for cell in cells if cell.strip()]
    return bool(filled) and all(is_instant(cell) for cell in filled)


def instants_of(cells: Sequence[str]) -> NDArray[Any]:
    """Clock times (n,) datetime64[ns], NaT for what is none.

    Times of day count from 1970-01-01. Of `03/05/2024` the first number is the month, of
    `03.05.2024` the day.
    """
    iso = pd.to_datetime(pd.Series(list(cells), dtype=object), format="ISO8601", utc=True,
                         errors="coerce")  # fmt: skip
    values = np.array(iso.dt.tz_localize(None), dtype="datetime64[ns]")
    for row in np.flatnonzero(np.isnat(values)).tolist():
        values[row] = _instant(cells[row])
    return values


def _instant(text: str) -> np.datetime64:
    match = INSTANT.fullmatch(text)
    if match is None:
        return np.datetime64("NaT", "ns")
    part = match.groupdict()
    year, month, day = part["year"], part["month"], part["day"]
    if part["c"]:
        month_first = "/" in text and int(part["a"]) <= 12
        year, month, day = (part["c"], part["a"], part["b"])
        if not month_first:
            month, day = day, month
    hour = int(part["hour"]) % 12 if part["half"] else int(part["hour"])
    if part["half"] and part["half"].lower() == "p":
        hour += 12
    try:
        date = np.datetime64(f"{int(year or 1970):04}-{int(month or 1):02}-{int(day or 1):02}")
    except ValueError:
        return np.datetime64("NaT", "ns")
    seconds = 3600 * hour + 60 * int(part["minute"]) + int(part["second"] or 0)
    seconds -= _zone_s(part["zone"] or "")
    fraction = int((part["part"] or "0").ljust(9, "0"))
    return np.datetime64(str(date), "ns") + np.timedelta64(seconds * 10**9 + fraction, "ns")


def _zone_s(zone: str) -> int:
    digits = re.sub(r"\D", "", zone)
    if not digits:
        return 0
    seconds = 3600 * int(digits[:2]) + 60 * int(digits[2:] or 0)
    return -seconds if zone.startswith("-") else seconds


def since(first: np.datetime64 | None, moments: NDArray[Any]) -> NDArray[np.float64]:
    """Seconds (n,) since a clock time, NaN where there is none; exact to a nanosecond.

    Times of day that begin anew at midnight go on.
    """
    if first is None:
        return np.full(len(moments), np.nan)
    passed = (moments - first).astype(np.int64)
    if first < np.datetime64(1, "D"):  # a time of day: only these are of 1970-01-01
        passed = passed + DAY_NS * (passed < -DAY_NS // 2)
    return np.where(np.isnat(moments), np.nan, passed / 1e9)
