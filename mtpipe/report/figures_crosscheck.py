"""The charts of the cross-check: the map of p-values, and recorded curves over simulated ones."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.report import words
from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    AXIS_SYMBOL,
    CALM,
    INK,
    PALE,
    Arrays,
    Figure,
    axis,
    band,
    layout,
    log_axis,
)
from mtpipe.report.rows_crosscheck import CrossCheckRows

# −log10 p at which the colours end.
DEEPEST = 6.0
SHADES = [[0.0, CALM], [1 / 3, "#fde3b8"], [2 / 3, "#d55e00"], [1.0, "#5c1a00"]]
LINE_PX, HOVER_WIDTH = 17, 70
# Densities are shown per µm: ticks such as 15 leave room between panels, 0.015 does not.
PER_UM = 1e3


def map_figure(found: CrossCheckRows) -> Figure:
    """Map of a bead: lines are axis and band or statistic, columns plateaus and all of them."""
    plateaus = sorted({cell.plateau for cell in found.cells if cell.plateau is not None})
    pooled = any(cell.plateau is None for cell in found.cells)
    columns = [*([None] if pooled else []), *plateaus]
    names = ["all" if number is None else str(number) for number in columns]
    at = {cell_key: i for i, cell_key in enumerate(columns)}
    down = {line: i for i, line in enumerate(found.lines)}
    depth: list[list[float | None]] = [[None] * len(columns) for _ in found.lines]
    text = [[""] * len(columns) for _ in found.lines]
    for cell in found.cells:
        row, column = down[cell.line], at[cell.plateau]
        depth[row][column] = round(min(-float(np.log10(max(cell.p_value, 1e-300))), 99.0), 2) + 0.0
        sentence = "<br>".join(textwrap.wrap(cell.text, HOVER_WIDTH))
        text[row][column] = f"p = {words.number(cell.p_value, 2)} of this cell<br>{sentence}"
    data = {
        "type": "heatmap",
        "x": names,
        "y": list(found.lines),
        "z": depth,
        "text": text,
        "hovertemplate": "%{text}<extra></extra>",
        "zmin": 0,
        "zmax": DEEPEST,
        "colorscale": SHADES,
        "xgap": 2,
        "ygap": 1,
        "colorbar": {
            "title": {"text": "p", "side": "right"},
            "tickvals": [0, 2, 4, 6],
            "ticktext": ["1", "10<sup>−2</sup>", "10<sup>−4</sup>", "≤ 10<sup>−6</sup>"],
            "thickness": 12,
            "len": 0.5,
            "y": 1,
            "yanchor": "top",
        },
    }
    made = layout(
        110 + LINE_PX * len(found.lines),
        xaxis=axis("plateau", type="category", side="top", showgrid=False),
        yaxis=axis(type="category", autorange="reversed", showgrid=False, dtick=1),
    )
    made["margin"] |= {"t": 60, "l": 170}
    return {"data": [data], "layout": made}


def curves_figure(arrays: Arrays, tables: Sequence[pd.DataFrame], axis_name: str) -> Figure:
    """Recorded curves of one trace over the simulated 95 %.

    Parameters
    ----------
    tables : spectrum, distribution of positions, Allan variance.
    """
    spectrum, histogram, allan = tables
    panels: list[tuple[pd.DataFrame, str, str, str]] = [
        (spectrum, "frequency_hz", "power_nm2_per_hz", "nm2_per_hz"),
        (histogram, "deviation_nm", "density_per_nm", "per_nm"),
        (allan, "averaged_s", "variance_nm2", "nm2"),
    ]
    data: list[dict[str, Any]] = []
    made = layout(360, showlegend=True)
    for number, (table, over, quantity, unit) in enumerate(panels, start=1):
        suffix = "" if number == 1 else str(number)
        on: dict[str, Any] = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
        named: dict[str, Any] = {"showlegend": number == 1}
        at, seen, middle, low, high = (
            table[name].to_numpy(np.float64)
            for name in (
                over,
                quantity,
                f"simulated_{unit}",
                f"simulated_low_{unit}",
                f"simulated_high_{unit}",
            )
        )
        logarithmic = number != 2
        if logarithmic:
            # a logarithmic axis has no zero
            low = np.where(low > 0, low, np.nan)
        else:
            seen, middle, low, high = (PER_UM * column for column in (seen, middle, low, high))
        data += [
            band(arrays, at, low, high, PALE, name="95 % of simulations", **named, **on),
            {
                "type": "scatter",
                "mode": "lines",
                "x": arrays.add(at),
                "y": arrays.add(middle),
                "name": "their median",
                "line": {"color": INK, "width": 1.2},
                "hovertemplate": "simulated %{y:.3g}<extra></extra>",
                **named,
                **on,
            },
            {
                "type": "scatter",
                "mode": "markers",
                "x": arrays.add(at),
                "y": arrays.add(seen),
                "name": "recorded",
                "marker": {"size": 5, "symbol": AXIS_SYMBOL[axis_name]}
                | {"color": AXIS_COLOUR[axis_name]},
                "hovertemplate": "%{x:.3g}: recorded %{y:.3g}<extra></extra>",
                **named,
                **on,
            },
        ]
        left = (number - 1) * 0.365
        place: dict[str, Any] = {"domain": [left, left + 0.27], "anchor": f"y{suffix}"}
        titles = (
            ("frequency / Hz", "power density / (nm²/Hz)"),
            ("deviation from the mean / nm", "density / (1/µm)"),
            ("averaged over / s", "Allan variance / nm²"),
        )[number - 1]
        if logarithmic:
            made[f"xaxis{suffix}"] = log_axis(titles[0], at, dense=20, **place)
            made[f"yaxis{suffix}"] = log_axis(titles[1], seen, dense=20, anchor=f"x{suffix}")
        else:
            made[f"xaxis{suffix}"] = axis(titles[0], nticks=5, **place)
            made[f"yaxis{suffix}"] = axis(titles[1], anchor=f"x{suffix}", nticks=5)
    return {"data": data, "layout": made}
