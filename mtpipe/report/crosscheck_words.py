"""The cross-check in words: what is compared, where, and what a p-value means."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mtpipe.crosschecking.battery.catalogue import KINDS
from mtpipe.crosschecking.battery.statistic import Kind
from mtpipe.report import words

# p-values: from the first on the sentence says "agree"; below the second the diagnosis has an
# alarm, and above it the verdict is "consistent".
CONSISTENT, MISMATCH = 0.05, 0.004
LINES = ("line", "second_line")


def _kind(statistic: str) -> Kind:
    """What a statistic is called; one of another version by its name."""
    name = words.label(statistic)
    return KINDS.get(statistic, Kind(statistic, name, name))


def line_of(row: Mapping[str, Any]) -> str:
    """The line of the map that a row of the table belongs to, without its axis."""
    line = _kind(str(row["statistic"])).line
    return line or f"{band(row)} Hz"


def band(row: Mapping[str, Any]) -> str:
    """The frequencies of a row."""
    return f"{words.number(row['band_low_hz'], 2)} – {words.number(row['band_high_hz'], 2)}"


def verdict(p_value: float, comparisons: int, simulations: int) -> str:
    """The p-value of all comparisons together, in a sentence."""
    p = words.probability(p_value)
    basis = f"{comparisons} comparisons with {simulations} simulations, counted together"
    if p_value >= CONSISTENT:
        return f"Recording and simulations agree: {p} ({basis})."
    once = words.number(1 / max(p_value, 1e-300), 2)
    often = f"by chance, one in {once} recordings of this experiment differs as much"
    if p_value >= MISMATCH:
        return f"No clear mismatch: {p}; {often} ({basis})."
    if p_value < 1 / (simulations + 1):
        often = (
            "no simulation differs as much, so this p-value is extrapolated from the spread of "
            "the simulations"
        )
    return f"Recording and simulations differ: {p}; {often} ({basis})."


def comparison(row: Mapping[str, Any]) -> str:
    """One row of the table in a sentence."""
    statistic = str(row["statistic"])
    what = _kind(statistic).words
    parts = [str(row["axis"])] if row["axis"] else []
    parts.append("all plateaus together" if row["plateau"] is None else f"plateau {row['plateau']}")
    if statistic in LINES:
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
        f"{', '.join(parts)}: {what} is {side} the simulated one, {_short(row['value'])} "
        f"instead of {spread} ({words.probability(row['p_value'])}"
    )
    return sentence + (", extrapolated)." if row["extrapolated"] else ").")


def place_in_words(located: Mapping[str, Any]) -> str:
    """An entry of `located` of `mismatch.json`: what differs and where."""
    statistic = str(located["statistic"])
    parts = [_kind(statistic).words]
    if located["axis"]:
        parts.append(f"along {words.listed(list(located['axis']))}")
    if located["band_hz"] is not None:
        low, high = located["band_hz"]
        if statistic in LINES:
            parts.append(f"at {words.number((low + high) / 2, 4)} Hz")
        else:
            parts.append(f"between {words.number(low, 2)} and {words.number(high, 2)} Hz")
    if located["plateaus"]:
        parts.append(f"in {words.plateaus(located['plateaus'])}")
    return f"{' '.join(parts)} ({words.probability(located['p_value'])})"


def _short(value: Any) -> str:
    return words.number(value, 3)
