"""Charts of what naming an effect changes: spectra of the clearest traces, and all residuals."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    AXIS_SYMBOL,
    CALM,
    GREY,
    INK,
    Arrays,
    Figure,
    axis,
    bars,
    layout,
    log_axis,
)
from mtpipe.report.words import number

STAGES = {"before": "as configured", "after": "with the causes found"}
# Domains of the upper and the lower row of spectra.
UPPER, LOWER = (0.44, 1.0), (0.0, 0.36)
# Standard errors at which the colours end; blue is too little, orange too much.
DEEPEST = 6.0
SHADES = [
    [0.0, "#003f66"], [0.25, "#4a9ac4"], [0.5, CALM], [0.75, "#e68a4a"], [1.0, "#5c1a00"],
]  # fmt: skip
LINE_PX = 17


def spectra_figure(arrays: Arrays, named: Mapping[str, Any]) -> Figure:
    """A column for each axis: recorded and expected power above, one over the other below.

    Parameters
    ----------
    named : `details/before_after.json` of the bead.
    """
    data: list[dict[str, Any]] = []
    made = layout(520, showlegend=True)
    made["margin"] |= {"t": 48}
    made["shapes"] = []
    ratios = [one[stage]["ratio"] for one in named["spectra"] for stage in STAGES]
    for column, one in enumerate(named["spectra"]):
        upper, lower = _numbered(column), _numbered(3 + column)
        frequency = np.array(one["frequency_hz"])
        colour, symbol = AXIS_COLOUR[one["axis"]], AXIS_SYMBOL[one["axis"]]
        above: dict[str, Any] = {"xaxis": f"x{upper}", "yaxis": f"y{upper}"}
        below: dict[str, Any] = {"xaxis": f"x{upper}", "yaxis": f"y{lower}", "showlegend": False}
        in_legend = {"showlegend": column == 0}
        expected, ratio = (
            {stage: np.array(one[stage][key]) for stage in STAGES}
            for key in ("expected_nm2_per_hz", "ratio")
        )
        recorded = ratio["after"] * expected["after"]
        points = {"type": "scatter", "mode": "markers", "x": arrays.add(frequency)}
        data.append(
            points
            | {
                "y": arrays.add(recorded),
                "name": "recorded",
                "marker": {"size": 5, "symbol": symbol, "color": colour},
                "hovertemplate": "%{x:.3g} Hz: recorded %{y:.3g}<extra></extra>",
                **in_legend,
                **above,
            }
        )
        for stage, line in (("before", {"color": GREY, "dash": "dash"}), ("after", {"color": INK})):
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": arrays.add(frequency),
                    "y": arrays.add(expected[stage]),
                    "name": f"expected {STAGES[stage]}",
                    "line": {"width": 1.4} | line,
                    "hovertemplate": "expected %{y:.3g}<extra></extra>",
                    **in_legend,
                    **above,
                }
            )
        for stage, shade in (("before", GREY), ("after", colour)):
            error = ratio[stage] / np.sqrt(one["ordinates"])
            open_ = "-open" if stage == "before" else ""
            data.append(
                points
                | {
                    "y": arrays.add(ratio[stage]),
                    "error_y": bars(arrays, error, shade),
                    "marker": {"size": 5, "symbol": f"{symbol}{open_}", "color": shade},
                    "hovertemplate": f"%{{x:.3g}} Hz: recorded over expected {STAGES[stage]} "
                    "%{y:.3g}<extra></extra>",
                    **below,
                }
            )
        left = column * 0.345
        where = f"{one['axis']}, plateau {one['plateau']}: frequency / Hz"
        made[f"xaxis{upper}"] = log_axis(
            where, frequency, dense=20, domain=[left, left + 0.28], anchor=f"y{lower}"
        )
        first = column == 0
        made[f"yaxis{upper}"] = log_axis(
            "power density / (nm²/Hz)" if first else "",
            np.concatenate([recorded, expected["before"], expected["after"]]),
            dense=20,
            domain=UPPER,
            anchor=f"x{upper}",
        )
        made[f"yaxis{lower}"] = log_axis(
            "recorded / expected" if first else "",
            np.concatenate([[0.9, 1.1], *ratios]),
            domain=LOWER,
            anchor=f"x{upper}",
            matches=f"y{_numbered(3)}",
        )
        made["shapes"].append(
            {
                "type": "line",
                "xref": f"x{upper} domain",
                "yref": f"y{lower}",
                "x0": 0,
                "x1": 1,
                "y0": 1,
                "y1": 1,
                "line": {"color": INK, "width": 1},
            }
        )
    return {"data": data, "layout": made}


def residuals_figure(named: Mapping[str, Any]) -> Figure:
    """Two maps side by side: lines are mean heights, and axis and band; columns are plateaus.

    Parameters
    ----------
    named : `details/before_after.json` of the bead.
    """
    edges = named["bands_hz"]
    bands = [f"{number(low, 2)} – {number(high, 2)} Hz" for low, high in itertools.pairwise(edges)]
    lines = ["mean height", *(f"{name}  {band}" for name in "xyz" for band in bands)]
    columns = [str(plateau) for plateau in named["plateaus"]]
    made = layout(120 + LINE_PX * len(lines))
    made["margin"] |= {"t": 78, "l": 170}
    made["annotations"] = []
    data: list[dict[str, Any]] = []
    for column, (stage, title) in enumerate(STAGES.items()):
        left = named["residuals"][stage]
        suffix, start = _numbered(column), 0.51 * column
        rows = [left["height"], *(row for name in "xyz" for row in left[name])]
        data.append(
            {
                "type": "heatmap",
                "x": columns,
                "y": lines,
                "z": [[None if z is None else round(z, 2) + 0.0 for z in row] for row in rows],
                "xaxis": f"x{suffix}",
                "yaxis": f"y{suffix}",
                "hovertemplate": "%{y}, plateau %{x}: %{z} standard errors<extra></extra>",
                "zmin": -DEEPEST,
                "zmax": DEEPEST,
                "colorscale": SHADES,
                "showscale": column == 0,
                "xgap": 2,
                "ygap": 1,
                "colorbar": {
                    "title": {"text": "standard errors", "side": "right"},
                    "tickvals": [-6, -3, 0, 3, 6],
                    "ticktext": ["≤ −6", "−3", "0", "3", "≥ 6"],
                    "thickness": 12,
                    "len": 0.5,
                    "y": 1,
                    "yanchor": "top",
                },
            }
        )
        made[f"xaxis{suffix}"] = axis(
            "plateau",
            type="category",
            side="top",
            showgrid=False,
            domain=[start, start + 0.49],
            anchor=f"y{suffix}",
        )
        made[f"yaxis{suffix}"] = axis(
            type="category",
            autorange="reversed",
            showgrid=False,
            dtick=1,
            showticklabels=column == 0,
            anchor=f"x{suffix}",
        )
        made["annotations"].append(
            {
                "text": f"<b>{title}</b>",
                "xref": f"x{suffix} domain",
                "yref": "paper",
                "x": 0.5,
                "y": 1,
                "yshift": 44,
                "yanchor": "bottom",
                "showarrow": False,
            }
        )
    return {"data": data, "layout": made}


def _numbered(i: int) -> str:
    """What plotly calls the axes of the i-th panel: nothing for the first."""
    return "" if i == 0 else str(i + 1)
