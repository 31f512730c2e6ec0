"""A design as a figure: error against force, and the ranges after single changes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mtpipe.design.guide import Design, error_curve
from mtpipe.design.limits import ForceRange
from mtpipe.design.methods import ACROSS, METHODS
from mtpipe.design.plan import OVERSTRETCHING_PN
from mtpipe.ground.errors import MtpipeError
from mtpipe.report.plotly_json import GREY, PALETTE, Figure, axis, layout, log_axis

POINTS = 60
# Errors above this are off the figure.
LARGEST_SHOWN = 1.0
WIDTH, HEIGHT = 1000, 900


def design_figure(design: Design) -> Figure:
    """Above, root-mean-square error against force; below, ranges with a change each."""
    colour = dict(zip(METHODS, PALETTE, strict=False))
    forces = np.geomspace(design.plan.lowest_force_pN, OVERSTRETCHING_PN, POINTS)
    data: list[dict[str, Any]] = []
    for one in design.ranges:
        errors = error_curve(design.plan, one.method, one.axis, forces, beyond=LARGEST_SHOWN)
        across = one.axis == ACROSS
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": forces.tolist(),
                "y": [100 * e if np.isfinite(e) else None for e in errors],
                "name": f"{METHODS[one.method].words}{', across the field' if across else ''}",
                "line": {"color": colour[one.method], "dash": "dot" if across else "solid"},
                "hovertemplate": "%{x:.3g} pN: %{y:.2g} %<extra>%{fullData.name}</extra>",
            }
        )
    first = [one for one in design.ranges if one.axis == METHODS[one.method].axes[0]]
    rows = [("as it is", tuple(first)), *((v.change.words, v.ranges) for v in design.variants)]
    for number, method in enumerate(METHODS):
        data.append(_bars(rows, number, colour[method]))
    limit = {"type": "line", "xref": "x domain", "x0": 0, "x1": 1, "yref": "y"}
    shapes = [limit | {"y0": 100 * design.error, "y1": 100 * design.error, "line": {"color": GREY}}]
    if design.reach_pN is not None:
        asked = {"type": "line", "xref": "x", "yref": "paper", "y0": 0, "y1": 1}
        dash = {"color": GREY, "dash": "dash"}
        shapes.append(asked | {"x0": design.reach_pN, "x1": design.reach_pN, "line": dash})
    made = layout(
        HEIGHT,
        xaxis=log_axis("", forces, anchor="y", matches="x2", showticklabels=False),
        yaxis=log_axis("error / %", [1.0, 100.0], anchor="x", domain=[0.56, 1.0]),
        xaxis2=log_axis("force / pN", forces, anchor="y2"),
        yaxis2=axis(
            "",
            anchor="x2",
            domain=[0.0, 0.52],
            range=[len(rows) - 0.5, -0.5],
            tickvals=list(range(len(rows))),
            ticktext=[words for words, _ in rows],
        ),
        shapes=shapes,
    )
    return {"data": data, "layout": made}


def write_figure(design: Design, path: Path) -> None:
    """Write the figure as a page that stands alone (.html) or as a picture (.png).

    Raises
    ------
    MtpipeError : another ending, or a picture without the package kaleido.
    """
    import plotly.io

    figure = design_figure(design)
    if path.suffix == ".html":
        plotly.io.write_html(figure, path, include_plotlyjs=True, validate=False)
        return
    if path.suffix != ".png":
        raise MtpipeError(
            "a figure is written as .html or .png", where=str(path), mend="Choose one of the two."
        )
    try:
        plotly.io.write_image(figure, path, width=WIDTH, height=HEIGHT, validate=False)
    except (ImportError, ValueError, RuntimeError) as error:
        if "kaleido" not in str(error).lower():
            raise
        raise MtpipeError(
            "a picture needs the package kaleido, which is not installed",
            where=str(path),
            mend="Install it, or write an .html figure, from which pictures can be saved.",
        ) from None


def _bars(
    rows: list[tuple[str, tuple[ForceRange, ...]]], number: int, colour: str
) -> dict[str, Any]:
    """Ranges of one method as lines, one in each row."""
    x: list[float | None] = []
    y: list[float | None] = []
    for i, (_, ranges) in enumerate(rows):
        one = ranges[number]
        if one.lower is not None and one.upper is not None:
            at = i + 0.12 * (number - (len(METHODS) - 1) / 2)
            x += [one.lower.force_pN, one.upper.force_pN, None]
            y += [at, at, None]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "xaxis": "x2",
        "yaxis": "y2",
        "line": {"color": colour, "width": 3},
        "showlegend": False,
        "hovertemplate": "%{x:.3g} pN<extra></extra>",
    }
