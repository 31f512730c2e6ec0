"""The cross-check in words: what a statistic looks at, where, and what a p-value means."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mtpipe.battery.words import STATISTICS
from mtpipe.report import words

CONSISTENT, MISMATCH = 0.05, 0.01


def line_of(row: Mapping[str, Any]) -> str:
    """The line of the map that a row of the table belongs to, without its axis."""
    line = STATISTICS.get(row["statistic"], (words.label(str(row["statistic"])), ""))[0]
    return line or f"{band(row)} Hz"


def band(row: Mapping[str, Any]) -> str:
    """The frequencies of a row."""
    return f"{words.number(row['band_low_hz'], 2)} – {words.number(row['band_high_hz'], 2)}"


def verdict(p_value: float, looks: int, simulations: int) -> str:
    """The p-value of all looks together, in a sentence."""
    p = words.number(p_value, 2)
    basis = f"{looks} looks together, beside {simulations} simulations"
    if p_value >= CONSISTENT:
        return f"Consistent with the configured experiment: p = {p} ({basis})."
    once = words.number(1 / max(p_value, 1e-300), 2)
    often = f"of {once} recordings that behave as configured, one looks as odd"
    if p_value >= MISMATCH:
        return f"No clear mismatch: p = {p}; {often} ({basis})."
    if p_value < 1 / (simulations + 1):
        often = (
            "none of the simulations looks as odd, and how far out it is follows from their tail"
        )
    said = "This bead does not behave as the configured experiment should"
    return f"{said}: p = {p}; {often} ({basis})."


def look(row: Mapping[str, Any]) -> str:
    """One row of the table in a sentence."""
    statistic = str(row["statistic"])
    what = STATISTICS.get(statistic, ("", words.label(statistic)))[1]
    parts = [str(row["axis"])] if row["axis"] else []
    parts.append("all plateaus together" if row["plateau"] is None else f"plateau {row['plateau']}")
    if statistic in ("line", "second_line"):
        parts.append(f"{words.number((row['band_low_hz'] + row['band_high_hz']) / 2, 4)} Hz")
    elif words.is_number(row["band_low_hz"]):
        parts.append(f"{band(row)} Hz")
    if words.is_number(row["time_low_s"]):
        parts.append(
            f"{words.number(row['time_low_s'], 3)} – {words.number(row['time_high_s'], 3)} s"
        )
    side = "above" if row["value"] > row["simulated_median"] else "below"
    spread = f"{_short(row['simulated_low'])} to {_short(row['simulated_high'])}"
    sentence = (
        f"{', '.join(parts)}: {what} is {side} what is simulated, {_short(row['value'])} "
        f"instead of {spread} (p = {words.number(row['p_value'], 2)}"
    )
    return sentence + (", by the tail fitted to the simulations)." if row["extrapolated"] else ").")


def _short(value: Any) -> str:
    return words.number(value, 3)
