"""What a file says of a column itself: its unit, scale and offset, what means lost, its rate.

HDF5 attributes, TDMS properties, Parquet metadata and rows of units all come down to one `Stated`
for each column. Conventions: netCDF's (CF 1.11, sections 2.5.1, 3.1 and 8.1) and LabVIEW's waveform
properties. What changes numbers in a way on which programs do not agree is not guessed but told.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.types import FloatArray

SCALE, OFFSET = {"scalefactor"}, {"addoffset"}
LOST = {"fillvalue", "missingvalue"}
LOWEST, HIGHEST, RANGE = {"validmin"}, {"validmax"}, {"validrange"}
# In the languages whose words for columns `mtpipe init` knows; "unité" and "unità" lose their last
# letter, as letters beyond a to z are left out.
UNIT = {
    "unit", "units", "unitstring", "niunitdescription", "einheit", "einheiten", "eenheid",
    "eenheden", "unite", "unites", "unidad", "unidades", "unita",
}  # fmt: skip
START = {"wfstartoffset"}
RATE = {
    "framerate", "fps", "framespersecond", "samplingrate", "samplerate", "samplingfrequency",
    "samplefrequency", "samplingfreq", "samplefreq", "acquisitionrate", "camerarate", "rate", "fs",
}  # fmt: skip
INTERVAL = {
    "wfincrement", "dt", "deltat", "timestep", "frameinterval", "frameperiod", "frametime",
    "samplinginterval", "sampleinterval", "sampleperiod", "sampletime", "cycletime", "period",
}  # fmt: skip
# Factors and sums by names that each program understands in its own way, and the value that
# changes nothing.
UNAGREED = {
    "scale": 1.0, "scaling": 1.0, "gain": 1.0, "slope": 1.0, "factor": 1.0, "multiplier": 1.0,
    "calibration": 1.0, "calibrationfactor": 1.0, "conversion": 1.0, "conversionfactor": 1.0,
    "offset": 0.0, "intercept": 0.0,
}  # fmt: skip
# What programs write that do not know the time between frames.
PLACEHOLDER_HZ = 1.0
RATE_TOLERANCE = 0.005
WITH_UNIT = re.compile(r"\s*([-+]?\d+(?:[.,]\d*)?(?:[eE][-+]?\d+)?)\s*([A-Za-zµμ/1]*)\s*")
PER_SECOND = {
    "": 1.0, "hz": 1.0, "khz": 1e3, "hertz": 1.0, "persecond": 1.0, "fps": 1.0, "1s": 1.0,
    "framess": 1.0, "framespersecond": 1.0,
}  # fmt: skip
SECONDS = {
    "": 1.0, "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3,
    "milliseconds": 1e-3, "us": 1e-6, "usec": 1e-6, "microseconds": 1e-6, "ns": 1e-9,
}  # fmt: skip


@dataclass(frozen=True)
class Stated:
    """What a file says of one column.

    Attributes
    ----------
    unit : as written, "" where there is none; `unit_words` says where, `unit_in_name` that it is
        a part of the column's name.
    scale, offset : the value is `scale` times the number plus `offset`; `changed_by` are the
        attributes that say this, or what means lost.
    lost : numbers that mean lost; so does what lies outside `lowest` to `highest`.
    rate_hz : rows per second, None where it is not said; `rate_words` says how it is written, and
        `rate_against` how the file contradicts it.
    start_s : time of the first row.
    unagreed : an attribute that may change the numbers, in no way that is agreed on.
    """

    unit: str = ""
    unit_words: str = ""
    unit_in_name: bool = False
    scale: float = 1.0
    offset: float = 0.0
    lost: tuple[float, ...] = ()
    lowest: float = -np.inf
    highest: float = np.inf
    changed_by: tuple[str, ...] = ()
    rate_hz: float | None = None
    rate_words: str = ""
    rate_against: str = ""
    start_s: float = 0.0
    unagreed: str = ""

    def physical(self, raw: NDArray[Any]) -> FloatArray:
        """Values of the file's numbers (n,), NaN where they mean lost."""
        with np.errstate(over="ignore", invalid="ignore"):  # of damaged files
            values = np.asarray(raw, dtype=np.float64)
        gone = np.isin(raw, self.lost) | (values < self.lowest) | (values > self.highest)
        if self.scale != 1.0 or self.offset:
            with np.errstate(over="ignore", invalid="ignore"):
                values = values * self.scale + self.offset
        return np.where(gone, np.nan, values) if gone.any() else values

    def within(self, surroundings: Stated) -> Stated:
        """The same with the rate that the group or file around the column gives, if it has none."""
        if surroundings.rate_hz is None or self.rate_hz not in (None, PLACEHOLDER_HZ):
            return self
        names = ("rate_hz", "rate_words", "rate_against")
        return replace(self, **{name: getattr(surroundings, name) for name in names})

    def beside(self, other: Stated) -> Stated:
        """The same with a rate that is said of the same column elsewhere; both have to agree."""
        if self.rate_hz in (None, PLACEHOLDER_HZ) or other.rate_hz in (None, PLACEHOLDER_HZ):
            return self.within(other)
        assert self.rate_hz is not None
        assert other.rate_hz is not None
        if abs(self.rate_hz / other.rate_hz - 1) <= RATE_TOLERANCE:
            return self
        return replace(self, rate_against=f"{other.rate_words} makes {other.rate_hz:.6g}")


NOTHING = Stated()


def stated_by(
    attributes: Mapping[str, Any], place: tuple[int, int] = (0, 1), *, where: str = ""
) -> Stated:
    """What attributes say of one column of their array.

    Parameters
    ----------
    place : its position (from 0) and the number of columns, as an attribute may hold a value
        for each.
    where : the group that the attributes are of, for messages.
    """
    said: dict[str, Any] = {}
    lost: list[float] = []
    changed: list[str] = []
    rates: list[Stated] = []
    of = f" of {where}" if where else ""
    for name, content in attributes.items():
        plain = re.sub(r"[^a-z0-9]", "", str(name).casefold())
        value = _one(content, *place)
        words = f"{name} = {value if isinstance(value, str) else _short(value)}{of}"
        if plain in UNIT and isinstance(value, str) and value.strip():
            said |= {"unit": value.strip(), "unit_words": words}
        number, in_unit = _number_and_unit(value)
        if number is None or not np.isfinite(number):
            pair = np.ravel(np.asarray(content)) if plain in RANGE else np.empty(0)
            if len(pair) == 2 and pair.dtype.kind in "iuf":
                said |= {"lowest": float(pair[0]), "highest": float(pair[1])}
                changed.append(f"{name} = {_short(pair[0])} to {_short(pair[1])}")
        elif plain in SCALE and number != 1:
            said["scale"] = number
            changed.append(words)
        elif plain in OFFSET and number:
            said["offset"] = number
            changed.append(words)
        elif plain in LOST:
            lost.append(number)
            changed.append(words)
        elif plain in LOWEST | HIGHEST:
            said["lowest" if plain in LOWEST else "highest"] = number
            changed.append(words)
        elif plain in START:
            said["start_s"] = number
        elif number != UNAGREED.get(plain, number):
            said["unagreed"] = words
        elif (rate := _rate_hz(plain + in_unit, number)) is not None:
            rates.append(Stated(rate_hz=rate, rate_words=words))
    stated = Stated(**said, lost=tuple(dict.fromkeys(lost)), changed_by=tuple(changed))
    return reduce(Stated.beside, rates, stated)


def _rate_hz(name: str, number: float) -> float | None:
    """Rows per second by a plain name such as `framerate` or `dtms`, None of any other."""
    if not 0 < number < np.inf:
        return None
    for known in RATE:
        if name.startswith(known) and name[len(known) :] in PER_SECOND:
            return number * PER_SECOND[name[len(known) :]]
    for known in INTERVAL:
        if name.startswith(known) and name[len(known) :] in SECONDS:
            return 1 / (number * SECONDS[name[len(known) :]])
    return None


def _one(content: Any, column: int, columns: int) -> Any:
    """The value of an attribute for one column: a number, text, or whatever else it is."""
    if isinstance(content, bytes):
        return content.decode("utf-8", "replace")
    if isinstance(content, str):
        return content
    array = np.ravel(np.asarray(content))
    if array.size == 1:
        value = array[0]
    elif array.size == columns:
        value = array[column]
    else:
        return content
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _number_and_unit(value: Any) -> tuple[float | None, str]:
    """The number of an attribute, None without, and the unit behind it, as in "50,5 Hz"."""
    if isinstance(value, (bool, np.bool_)):
        return None, ""
    if isinstance(value, str) and (match := WITH_UNIT.fullmatch(value)):
        return float(match[1].replace(",", ".")), re.sub(
            r"[^a-z0-9]", "", match[2].casefold().replace("μ", "u")
        )
    try:
        return float(value), ""
    except (TypeError, ValueError):
        return None, ""


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, (float, np.floating)) else str(value)[:60]
