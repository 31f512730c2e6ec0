"""The charts of the whole run: forces of all beads, and the drift that was subtracted."""

from __future__ import annotations

from typing import Any

import numpy as np

from mtpipe.report.folder import RunFolder
from mtpipe.report.plateau_forces import drawn_forces
from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    AXIS_SYMBOL,
    GREY,
    PALETTE,
    Arrays,
    Figure,
    axis,
    bars,
    layout,
    log_axis,
    positive,
    with_gaps,
)

SYMBOLS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "cross", "x", "star")


def forces_figure(arrays: Arrays, folder: RunFolder, beads: list[str]) -> Figure:
    """Force against magnet position (or plateau) of every bead.

    A point where x and y share the force; else a full one from x and an open one from y. Up to
    eight beads have a colour and a sign each; more are drawn alike, named under the pointer.
    """
    forces = drawn_forces(folder.forces)
    by_magnet = bool(len(forces)) and bool(forces["magnet_mm"].notna().all())
    across, unit = ("magnet_mm", " mm") if by_magnet else ("plateau", "")
    data: list[dict[str, Any]] = []
    named = [bead for bead in beads if (forces["bead"] == bead).any()]
    distinct = len(named) <= len(PALETTE)
    for number, bead in enumerate(named):
        colour = PALETTE[number] if distinct else GREY
        mine = forces[forces["bead"] == bead].sort_values(across)
        for first, (mark, table) in enumerate(
            (("", mine[mine["source"] != "y"]), ("-open", mine[mine["source"] == "y"]))
        ):
            if not len(table):
                continue
            data.append(
                {
                    "type": "scatter",
                    "mode": "markers" if mark else "lines+markers",
                    "name": escaped(bead),
                    "legendgroup": str(number),
                    "showlegend": distinct and not first,
                    "x": arrays.add(table[across]),
                    "y": arrays.add(table["force_pN"]),
                    "error_y": bars(arrays, table["force_stderr_pN"], colour),
                    "line": {"color": colour, "width": 1},
                    "marker": {
                        "symbol": SYMBOLS[number % len(SYMBOLS)] + mark,
                        "size": 7,
                        "color": colour,
                    },
                    "text": list(table["source"]),
                    "hovertemplate": f"{escaped(bead)}, from %{{text}}<br>%{{x:.4g}}{unit}: "
                    "%{y:.3g} pN<extra></extra>",
                }
            )
    title = "magnet position / mm" if by_magnet else "plateau"
    return {
        "data": data,
        "layout": layout(
            380,
            xaxis=axis(title, **({} if by_magnet else {"dtick": 1})),
            yaxis=log_axis("force / pN", positive(forces["force_pN"])),
        ),
    }


def drift_figure(arrays: Arrays, folder: RunFolder) -> Figure:
    """What was subtracted from every trace, per axis."""
    data = []
    for name in "xyz":
        table = folder.drift[folder.drift["axis"] == name].sort_values("time_s")
        columns = (table[c].to_numpy(np.float64) for c in ("time_s", "drift_nm"))
        t, nm = with_gaps(*columns)
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": name,
                "x": arrays.add(t),
                "y": arrays.add(nm),
                "line": {"color": AXIS_COLOUR[name], "width": 1.3}
                | {"dash": {"x": "solid", "y": "dash", "z": "dot"}[name]},
                "marker": {"symbol": AXIS_SYMBOL[name]},
                "hovertemplate": f"%{{x:.1f}} s: {name} %{{y:.1f}} nm<extra></extra>",
            }
        )
    return {
        "data": data,
        "layout": layout(320, xaxis=axis("time / s"), yaxis=axis("drift subtracted / nm")),
    }


def escaped(name: str) -> str:
    """A name for plotly, which reads some HTML in its texts and `%{...}` in its templates."""
    safe = name.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return safe.replace("%{", "% {")
