"""Charts of what no effect explains: spectra, courses of time and distributions, and the smooth
curves through them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mtpipe.ground.types import FloatArray
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

# Of each kind of shape: the two axes in words, and the unit across.
SHAPE_WORDS = {
    "mean": ("time / s", "mean position / nm", " s"),
    "variance": ("time / s", "variance / that of the plateau", " s"),
    "distribution": ("position / standard deviation", "density / normal", ""),
}


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
            legend = {"name": "correction", "showlegend": not named["line"]}
            hover = "%{x:.3g} Hz: factor %{y:.3g}<extra></extra>"
            data += _smooth(arrays, at, factor, low, high, hovertemplate=hover, **legend, **on)
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


def left_shapes(run: RunFolder, bead: str) -> Sequence[Mapping[str, Any]]:
    """Courses of time and distributions that are to be drawn."""
    shapes: Sequence[Mapping[str, Any]] = run.unexplained.get(bead, {"shapes": ()})["shapes"]
    return shapes


def shapes_figure(arrays: Arrays, shapes: Sequence[Mapping[str, Any]]) -> Figure:
    """A panel for each."""
    data: list[dict[str, Any]] = []
    made = layout(320, showlegend=False)
    made["shapes"] = []
    width = 0.42 if len(shapes) > 1 else 1.0
    for number, shape in enumerate(shapes, start=1):
        suffix = "" if number == 1 else str(number)
        on: dict[str, Any] = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
        across, along, hover = SHAPE_WORDS[shape["kind"]]
        at, value, low, high, curve, curve_low, curve_high = (
            np.array(shape[key], dtype=float)
            for key in (
                "at", "value", "value_low", "value_high", "curve", "curve_low", "curve_high",
            )
        )  # fmt: skip
        colour = AXIS_COLOUR[shape["axis"]]
        data += _smooth(arrays, at, curve, curve_low, curve_high, hoverinfo="skip", **on)
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": arrays.add(at),
                "y": arrays.add(value),
                "error_y": bars(arrays, high - value, colour, below=value - low),
                "marker": {"size": 5, "symbol": AXIS_SYMBOL[shape["axis"]], "color": colour},
                "hovertemplate": f"%{{x:.3g}}{hover}: %{{y:.3g}}<extra></extra>",
                **on,
            }
        )
        left = 0.0 if number == 1 else 1 - width
        where = f"{shape['axis']}, plateau {shape['plateau']}"
        made[f"xaxis{suffix}"] = {
            "title": {"text": f"{where}: {across}"},
            "domain": [left, left + width],
            "anchor": f"y{suffix}",
        }
        if shape["kind"] == "mean":
            made[f"yaxis{suffix}"] = {"title": {"text": along}, "anchor": f"x{suffix}"}
        else:
            made[f"yaxis{suffix}"] = log_axis(along, [*value, 0.9, 1.1], anchor=f"x{suffix}")
        none = 0 if shape["kind"] == "mean" else 1
        line = {"color": GREY, "width": 1, "dash": "dash"}
        ends = {"x0": 0, "x1": 1, "y0": none, "y1": none}
        on_panel = {"type": "line", "xref": f"x{suffix} domain", "yref": f"y{suffix}"}
        made["shapes"].append({**on_panel, **ends, "line": line})
    return {"data": data, "layout": made}


def _smooth(
    arrays: Arrays,
    at: FloatArray,
    curve: FloatArray,
    low: FloatArray,
    high: FloatArray,
    **keys: Any,
) -> list[dict[str, Any]]:
    """A smooth curve on its band. `keys` : of the curve; its axes are also the band's."""
    on = {key: keys[key] for key in ("xaxis", "yaxis")}
    line = {"color": INK, "width": 1.6}
    return [
        band(arrays, at, low, high, PALE, showlegend=False, **on),
        {
            "type": "scatter",
            "mode": "lines",
            "x": arrays.add(at),
            "y": arrays.add(curve),
            "line": line,
            **keys,
        },
    ]
