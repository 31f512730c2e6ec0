"""The charts of one trace: its spectrum with the fit and the residuals, and its posterior."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import gamma

from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    AXIS_SYMBOL,
    INK,
    PALE,
    PALER,
    Arrays,
    Figure,
    axis,
    band,
    layout,
    log_axis,
    note,
)

POSTERIOR_DRAWN = 400  # points in a scatter; more only overlap


def spectrum_figure(arrays: Arrays, table: pd.DataFrame, axis_name: str) -> Figure:
    """Spectrum and model of one trace above, data over model below.

    A bin that averages n ordinates of a periodogram scatters about the model as a Gamma variable
    of shape n and mean 1; the bands are its central 68 and 95 %.
    """
    table = table.sort_values("frequency_hz")
    f, n, power, model = (
        table[name].to_numpy(np.float64)
        for name in ("frequency_hz", "ordinates", "power_nm2_per_hz", "model_nm2_per_hz")
    )
    ratio = power / model
    edge = {
        q: np.where(np.isfinite(model), gamma.ppf(q, n, scale=1 / n), np.nan)
        for q in (0.025, 0.16, 0.84, 0.975)
    }
    colour = AXIS_COLOUR[axis_name]
    points = {
        "type": "scatter",
        "mode": "markers",
        "x": arrays.add(f),
        "customdata": arrays.add(n),
        "marker": {"color": colour, "size": 5, "symbol": AXIS_SYMBOL[axis_name]},
    }
    lower: dict[str, Any] = {"yaxis": "y2", "showlegend": False}
    data: list[dict[str, Any]] = [
        band(arrays, f, model * edge[0.025], model * edge[0.975], PALER, name="95 % of bins"),
        band(arrays, f, model * edge[0.16], model * edge[0.84], PALE, name="68 % of bins"),
        points
        | {
            "y": arrays.add(power),
            "name": "data",
            "hovertemplate": "%{x:.3g} Hz: %{y:.3g} nm²/Hz<br>mean of %{customdata} ordinates"
            "<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": arrays.add(f),
            "y": arrays.add(model),
            "name": "fitted model",
            "line": {"color": INK, "width": 1.5},
            "hovertemplate": "model %{y:.3g} nm²/Hz<extra></extra>",
        },
        band(arrays, f, edge[0.025], edge[0.975], PALER, **lower),
        band(arrays, f, edge[0.16], edge[0.84], PALE, **lower),
        points
        | lower
        | {
            "y": arrays.add(ratio),
            "hovertemplate": "%{x:.3g} Hz: data/model %{y:.3g}<br>mean of %{customdata} ordinates"
            "<extra></extra>",
        },
    ]
    one = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": "y2", "y0": 1, "y1": 1}
    return {
        "data": data,
        "layout": layout(
            460,
            xaxis=log_axis("frequency / Hz", f, anchor="y2"),
            yaxis=log_axis("power density / (nm²/Hz)", power, domain=[0.36, 1]),
            yaxis2=log_axis("data / model", ratio, dense=20, domain=[0, 0.28]),
            shapes=[one | {"line": {"color": INK, "width": 1}}],
            annotations=[] if np.isfinite(model).any() else [note("no model: trace refused")],
        ),
    }


def posterior_figure(arrays: Arrays, table: pd.DataFrame, axis_name: str) -> Figure:
    """Posterior of one trace: stiffness against friction with marginals, and the force."""
    table = table.iloc[:: max(1, -(-len(table) // POSTERIOR_DRAWN))]
    colour = AXIS_COLOUR[axis_name]
    columns = {
        "stiffness": (table["stiffness_pN_per_nm"].to_numpy(np.float64) * 1e3, "10⁻³ pN/nm"),
        "friction": (table["friction_pN_s_per_nm"].to_numpy(np.float64) * 1e6, "10⁻⁶ pN·s/nm"),
        "force": (table["force_pN"].to_numpy(np.float64), "pN"),
    }
    kept = {name: arrays.add(values) for name, (values, _) in columns.items()}
    bars: dict[str, Any] = {"type": "histogram", "marker": {"color": colour}, "opacity": 0.75}
    bars |= {"showlegend": False, "nbinsx": 30, "nbinsy": 30}
    counts: dict[str, Any] = {
        "showticklabels": False,
        "ticks": "",
        "showgrid": False,
        "fixedrange": True,
    }
    has_force = bool(np.isfinite(columns["force"][0]).any())
    right = 0.56 if has_force else 1.0
    split = right - 0.1
    data: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "markers",
            "x": kept["friction"],
            "y": kept["stiffness"],
            "marker": {"color": colour, "size": 4, "opacity": 0.5},
            "showlegend": False,
            "hovertemplate": "friction %{x:.4g} × 10⁻⁶ pN·s/nm<br>stiffness %{y:.4g} × 10⁻³ pN/nm"
            "<extra></extra>",
        },
        bars | {"x": kept["friction"], "yaxis": "y2", "hovertemplate": "%{x}: %{y}<extra></extra>"},
        bars
        | {"y": kept["stiffness"], "xaxis": "x2", "hovertemplate": "%{y}: %{x}<extra></extra>"},
    ]
    made = layout(
        360,
        bargap=0.04,
        xaxis=axis(f"friction / ({columns['friction'][1]})", domain=[0, split], nticks=5),
        yaxis=axis(f"stiffness / ({columns['stiffness'][1]})", domain=[0, 0.78]),
        yaxis2=axis(domain=[0.82, 1], anchor="x", **counts),
        xaxis2=axis(domain=[split + 0.02, right], anchor="y", **counts),
        shapes=[],
    )
    if has_force:
        data.append(
            bars
            | {"x": kept["force"], "xaxis": "x3", "yaxis": "y3"}
            | {"hovertemplate": "%{x} pN: %{y} of the sample<extra></extra>"}
        )
        made["xaxis3"] = axis("force / pN", domain=[0.66, 1], anchor="y3", nticks=5)
        made["yaxis3"] = axis(domain=[0, 1], anchor="x3", **counts)
        made["shapes"] = _force_lines(columns["force"][0])
    return {"data": data, "layout": made}


def _force_lines(force_pN: NDArray[np.float64]) -> list[dict[str, Any]]:
    """The sample's median, and a box from its 16 % to its 84 %."""
    low, middle, high = np.nanquantile(force_pN, [0.16, 0.5, 0.84]).tolist()
    base = {"xref": "x3", "yref": "y3 domain", "y0": 0, "y1": 1}
    box = {"type": "rect", "x0": low, "x1": high, "fillcolor": PALE, "layer": "below"}
    line = {"type": "line", "x0": middle, "x1": middle}
    dash = {"color": INK, "width": 1.5, "dash": "dash"}
    return [base | box | {"line": {"width": 0}}, base | line | {"line": dash}]
