"""The chart of whether x and y agree: the force from each alone over the force to quote."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mtpipe.report.plateau_forces import Comparison
from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    AXIS_SYMBOL,
    GREY,
    PALE,
    Arrays,
    Figure,
    axis,
    bars,
    layout,
    log_axis,
)

# x and y of a plateau stand side by side, this share of the axis apart.
APART = 0.012
# Bars that reach further than this many times the farthest point are cut off.
REACH = 2.0


def agreement_figure(arrays: Arrays, compared: Sequence[Comparison]) -> Figure:
    """Force from x and from y alone over the one to quote; grey: the standard error of that one."""
    if not any(one.alone for one in compared):
        return {"data": [], "layout": layout(380)}
    given = np.array([one.given for one in compared])
    side = max(np.ptp(np.log(given)), 1.0) * APART
    data: list[dict[str, Any]] = []
    far, ends = 0.05, 0.0
    for name, step in (("x", -side / 2), ("y", side / 2)):
        mine = [one for one in compared if name in one.alone]
        if not mine:
            continue
        whole = np.array([one.given for one in mine])
        values = np.array([one.alone[name] for one in mine])
        value, _, low, high = (column / whole for column in values.T)
        far = max(far, float(np.max(np.abs(value - 1))))
        ends = max(ends, float(np.max(high - 1)), float(np.max(1 - low)))
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": f"{name} alone",
                "x": arrays.add(whole * np.exp(step)),
                "y": arrays.add(value),
                "error_y": bars(arrays, high - value, AXIS_COLOUR[name], below=value - low),
                "text": [_hover(one, name) for one in mine],
                "marker": {"color": AXIS_COLOUR[name], "size": 8, "symbol": AXIS_SYMBOL[name]},
                "hovertemplate": "%{text}<extra></extra>",
            }
        )
    shapes = [_given(one, side) for one in compared]
    line = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1}
    reach = 1.08 * min(ends, REACH * far + max(one.given_stderr / one.given for one in compared))
    return {
        "data": data,
        "layout": layout(
            380,
            xaxis=log_axis("force to quote / pN", given),
            yaxis=axis("force alone / force to quote", range=[1 - reach, 1 + reach]),
            shapes=[*shapes, line | {"line": {"color": GREY, "width": 1, "dash": "dash"}}],
        ),
    }


def _given(one: Comparison, side: float) -> dict[str, Any]:
    """A grey box: the standard error of the force given."""
    relative = one.given_stderr / one.given
    return {
        "type": "rect",
        "layer": "below",
        "fillcolor": PALE,
        "line": {"width": 0},
        "x0": float(one.given * np.exp(-1.6 * side)),
        "x1": float(one.given * np.exp(1.6 * side)),
        "y0": 1 - relative,
        "y1": 1 + relative,
    }


def _hover(one: Comparison, name: str) -> str:
    value, stderr = one.alone[name][:2]
    return (
        f"plateau {one.plateau}<br>{name} alone {value:.4g} ± {stderr:.2g} pN<br>"
        f"to quote {one.given:.4g} ± {one.given_stderr:.2g} pN"
    )
