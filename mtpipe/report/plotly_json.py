"""Figures as plotly reads them: plain dictionaries, their arrays packed and shared within a page.

The figures are not built with the plotly package, whose validation takes longer than the fits; a
test checks them against it. Arrays go into the page once each, as base64 of little-endian numbers
in single precision; `report.js` puts them back where a figure says `{"array": i}`.
"""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Figure = dict[str, Any]

# Okabe and Ito's palette: told apart by the colour-blind and, by lightness, in grey print.
AXIS_COLOUR = {"x": "#0072b2", "y": "#d55e00", "z": "#009e73"}
AXIS_SYMBOL = {"x": "circle", "y": "square", "z": "diamond"}
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#8c6d1f")
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "cross", "x", "star")
# Forces to quote.
QUOTED_COLOUR = "#6a3d9a"
INK, GREY, PALE, PALER, PAPER = "#222222", "#767676", "#d5d9de", "#eceef1", "#ffffff"
# The ground of plateaus in traces, and of cells of a map in which nothing differs.
PLATEAU, CALM = "#f4f5f7", "#f6f7f9"
# What the page puts in their place on a dark screen. Colours of data become lighter, so that they
# stand out from the ground by 4.5 to 1 and more (WCAG 2.2, contrast).
# Ratios of what a damaged file holds may leave the range of doubles, ticks beyond them do.
LOG_RANGE = (1e-100, 1e100)
DARK = {
    INK: "#e6e8eb",
    GREY: "#9aa3ac",
    PALE: "#454d56",
    PALER: "#2c333a",
    PAPER: "#14181c",
    PLATEAU: "#1e242a",
    CALM: "#1e242a",
    QUOTED_COLOUR: "#b79be0",
    "#0072b2": "#4aa8e0",
    "#d55e00": "#f08a3c",
    "#009e73": "#2fc49a",
    "#cc79a7": "#dd98bf",
    "#000000": "#e6e8eb",
    "#8c6d1f": "#c8a44d",
    # steps of the maps' scales, which end light where the ground is dark
    "#fde3b8": "#5a3a14",
    "#e68a4a": "#a4561c",
    "#5c1a00": "#ffd9a8",
    "#4a9ac4": "#2c6f96",
    "#003f66": "#bfe2f7",
}


class Arrays:
    """The arrays of a page, each kept once."""

    def __init__(self) -> None:
        self._index: dict[bytes, int] = {}

    def add(self, values: ArrayLike) -> Any:
        """Keep an array (any numbers, one dimension); NaN becomes a gap in the line."""
        with np.errstate(over="ignore"):
            packed = np.asarray(values, dtype="<f4").tobytes()
        return {"array": self._index.setdefault(packed, len(self._index))}

    def packed(self) -> list[str]:
        """The arrays in base64, in the order of their numbers."""
        return [base64.b64encode(data).decode("ascii") for data in self._index]


class PlainArrays(Arrays):
    """Arrays that stay where they are, for a figure by itself."""

    def add(self, values: ArrayLike) -> Any:
        """The array."""
        return np.asarray(values)


def layout(height: int, **extra: Any) -> dict[str, Any]:
    """What all figures have in common."""
    return {
        "height": height,
        "autosize": True,
        "margin": {"l": 68, "r": 16, "t": 34, "b": 50},
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": INK},
        "paper_bgcolor": PAPER,
        "plot_bgcolor": PAPER,
        "hoverlabel": {"bgcolor": PAPER, "font": {"color": INK}},
        "legend": {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom", "font": {"size": 12}}
        | {"bgcolor": "rgba(0,0,0,0)"},  # what it lies over, as the topmost label of an axis, shows
        "dragmode": "zoom",
        **extra,
    }


def axis(title: str = "", **extra: Any) -> dict[str, Any]:
    """An axis with title, ticks outside and a pale grid."""
    made: dict[str, Any] = {
        "title": {"text": title, "standoff": 8, "font": {"size": 13}},
        "gridcolor": PALER,
        "linecolor": GREY,
        "showline": True,
        "ticks": "outside",
        "tickcolor": GREY,
        "zeroline": False,
        "automargin": True,
        "exponentformat": "none",
        **extra,
    }
    return made


def log_axis(title: str, values: ArrayLike, *, dense: float = 200, **extra: Any) -> dict[str, Any]:
    """A logarithmic axis with labels at the decades, at 2 and 5 as well up to a ratio of `dense`.

    The labels are set here because plotly's own are "2" and "5" whatever the decade.
    """
    seen = np.clip(positive(values), *LOG_RANGE)
    low, high = (seen.min(), seen.max()) if len(seen) else (0.1, 10.0)
    steps = (1, 2, 5) if high / low < dense else (1,)
    decades = range(math.floor(math.log10(low)) - 2, math.ceil(math.log10(high)) + 3)
    ticks = {
        "tickvals": [step * 10.0**decade for decade in decades for step in steps],
        "ticktext": [_power(step, decade) for decade in decades for step in steps],
        "minor": {"ticks": "outside", "ticklen": 3, "dtick": "D1"},
    }
    return axis(title, type="log", **ticks, **extra)


def bars(
    arrays: Arrays, values: ArrayLike, colour: str, *, below: ArrayLike | None = None
) -> dict[str, Any]:
    """Error bars, lopsided if `below` is given."""
    made: dict[str, Any] = {"type": "data", "array": arrays.add(values), "color": colour}
    if below is not None:
        made |= {"symmetric": False, "arrayminus": arrays.add(below)}
    return made | {"thickness": 1.2, "width": 3}


def _power(step: int, decade: int) -> str:
    if -4 < decade < 4:
        return f"{step * 10.0**decade:g}"
    return f"{'' if step == 1 else f'{step}×'}10<sup>{decade}</sup>".replace("-", "−")


def positive(values: ArrayLike) -> NDArray[np.float64]:
    """The positive finite values."""
    array = np.asarray(values, dtype=np.float64)
    return array[np.isfinite(array) & (array > 0)]


def outline(
    x: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Closed outlines around low and high, one for each stretch without NaN, parted by NaN."""
    good = np.isfinite(low) & np.isfinite(high)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(np.int8)))
    xs: list[NDArray[np.float64]] = []
    ys: list[NDArray[np.float64]] = []
    gap = np.array([np.nan])
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        there = slice(start, stop)
        xs += [x[there], x[there][::-1], gap]
        ys += [low[there], high[there][::-1], gap]
    if not xs:
        return np.empty(0), np.empty(0)
    return np.concatenate(xs[:-1]), np.concatenate(ys[:-1])


def with_gaps(x: NDArray[np.float64], *ys: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Put a row of NaN wherever x jumps by more than three of its usual steps.

    A line then breaks where a stretch of time is missing, instead of bridging it.
    """
    steps = np.diff(x)
    gaps = np.flatnonzero(steps > 3 * np.median(steps)) + 1 if len(steps) else np.empty(0, int)
    return [np.insert(values, gaps, np.nan) for values in (x, *ys)]


def band(
    arrays: Arrays,
    x: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    colour: str,
    **extra: Any,
) -> dict[str, Any]:
    """A filled band without hover."""
    xs, ys = outline(x, low, high)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": arrays.add(xs),
        "y": arrays.add(ys),
        "fill": "toself",
        "fillcolor": colour,
        "line": {"width": 0},
        "hoverinfo": "skip",
        **extra,
    }


def note(text: str, **where: str) -> dict[str, Any]:
    """Grey words in the middle of a figure or, with `xref` and `yref`, of a panel."""
    at = {"xref": "paper", "yref": "paper"} | where
    return at | {"text": text, "x": 0.5, "y": 0.5, "showarrow": False, "font": {"color": GREY}}


def escaped(name: str) -> str:
    """A name for plotly, which reads some HTML in its texts and `%{...}` in its templates."""
    safe = name.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return safe.replace("%{", "% {")
