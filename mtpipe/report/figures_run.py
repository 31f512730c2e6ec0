"""The charts of the whole run: forces of all beads, and the drift that was subtracted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.report import words
from mtpipe.report.folder import RunFolder
from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    AXIS_SYMBOL,
    GREY,
    PALETTE,
    SYMBOLS,
    Arrays,
    Figure,
    axis,
    bars,
    escaped,
    layout,
    log_axis,
    positive,
    with_gaps,
)

# Sources of forces of a bead that differs from its simulation for no known reason.
UNSURE = ("spectra_alone", "heights_alone")


def forces_figure(arrays: Arrays, forces: pd.DataFrame, beads: Sequence[str]) -> Figure:
    """Force to quote against magnet position (or plateau) of every bead.

    Open where something is not explained.
    Up to eight beads have a colour and a sign each; more are drawn alike, named under the pointer.

    Parameters
    ----------
    forces : a row per bead and plateau that has a force to quote.
    """
    by_magnet = bool(len(forces)) and bool(forces["magnet_mm"].notna().all())
    across, unit = ("magnet_mm", " mm") if by_magnet else ("plateau", "")
    data: list[dict[str, Any]] = []
    named = [bead for bead in beads if (forces["bead"] == bead).any()]
    distinct = len(named) <= len(PALETTE)
    for number, bead in enumerate(named):
        colour = PALETTE[number] if distinct else GREY
        mine = forces[forces["bead"] == bead].sort_values(across)
        sign = SYMBOLS[number % len(SYMBOLS)]
        data.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": escaped(bead),
                "x": arrays.add(mine[across]),
                "y": arrays.add(mine["force_pN"]),
                "error_y": bars(arrays, mine["force_stderr_pN"], colour),
                "line": {"color": colour, "width": 1},
                "marker": {
                    "symbol": [
                        f"{sign}-open" if source in UNSURE else sign
                        for source in mine["force_source"]
                    ],
                    "size": 7,
                    "color": colour,
                },
                "text": [
                    words.SOURCE.get(source, words.text(source)) for source in mine["force_source"]
                ],
                "hovertemplate": f"{escaped(bead)}<br>%{{x:.4g}}{unit}: %{{y:.3g}} pN"
                "<br>%{text}<extra></extra>",
            }
        )
    title = "magnet position / mm" if by_magnet else "plateau"
    return {
        "data": data,
        "layout": layout(
            380,
            showlegend=has_legend(named),
            xaxis=axis(title, **({} if by_magnet else {"dtick": 1})),
            yaxis=log_axis("force to quote / pN", positive(forces["force_pN"])),
        ),
    }


def has_legend(beads: Sequence[str]) -> bool:
    """Whether a chart of these beads names them in a legend: more than one, and told apart."""
    return 1 < len(beads) <= len(PALETTE)


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
