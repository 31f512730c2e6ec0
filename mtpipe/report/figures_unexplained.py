"""The chart of what no effect explains: recorded over expected power, and its smooth correction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mtpipe.report.folder import RunFolder
from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    AXIS_SYMBOL,
    GREY,
    INK,
    PALE,
    Arrays,
    Figure,
    band,
    bars,
    layout,
    log_axis,
)


def left_panels(run: RunFolder, bead: str) -> Sequence[Mapping[str, Any]]:
    """What is to be drawn of each axis; none where the spectrum needs no correction."""
    correction = run.unexplained.get(bead, {"correction": None})["correction"]
    return () if correction is None else correction["panels"]


def unexplained_figure(arrays: Arrays, panels: Sequence[Mapping[str, Any]]) -> Figure:
    """A panel for each axis, on a common scale."""
    data: list[dict[str, Any]] = []
    made = layout(360, showlegend=True)
    seen = np.concatenate([[0.9, 1.1], *(panel["ratio"] for panel in panels)])
    named = {"points": False, "line": False}
    for number, panel in enumerate(panels, start=1):
        suffix = "" if number == 1 else str(number)
        on: dict[str, Any] = {"xaxis": f"x{suffix}", "yaxis": "y"}
        name = panel["axis"]
        correction = panel["correction"]
        if correction is not None:
            at, factor, low, high = (
                np.array(correction[key])
                for key in ("frequency_hz", "factor", "factor_low", "factor_high")
            )
            data += [
                band(arrays, at, low, high, PALE, showlegend=False, **on),
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": arrays.add(at),
                    "y": arrays.add(factor),
                    "name": "correction",
                    "showlegend": not named["line"],
                    "line": {"color": INK, "width": 1.6},
                    "hovertemplate": "%{x:.3g} Hz: factor %{y:.3g}<extra></extra>",
                    **on,
                },
            ]
            named["line"] = True
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": arrays.add(panel["frequency_hz"]),
                "y": arrays.add(panel["ratio"]),
                "error_y": bars(arrays, panel["ratio_stderr"], AXIS_COLOUR[name]),
                "name": "recorded / expected",
                "showlegend": not named["points"],
                "marker": {"size": 5, "symbol": AXIS_SYMBOL[name], "color": AXIS_COLOUR[name]},
                "hovertemplate": "%{x:.3g} Hz: recorded / expected %{y:.3g}<extra></extra>",
                **on,
            }
        )
        named["points"] = True
        where = "" if panel["plateau"] is None else f", plateau {panel['plateau']}"
        left = (number - 1) * 0.345
        made[f"xaxis{suffix}"] = log_axis(
            f"{name}{where}: frequency / Hz",
            panel["frequency_hz"],
            dense=20,
            domain=[left, left + 0.31],
            anchor="y",
        )
    made["yaxis"] = log_axis("recorded / expected power", seen, anchor="x")
    line = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1}
    made["shapes"] = [line | {"line": {"color": GREY, "width": 1, "dash": "dash"}}]
    return {"data": data, "layout": made}
