"""Mean x and y against mean z over the plateaus: tilts and cross-talk show as slopes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.report.folder import RunFolder, records
from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    GREY,
    PALETTE,
    SYMBOLS,
    Arrays,
    Figure,
    axis,
    bars,
    escaped,
    layout,
)

LATERAL = ("x", "y")
# Share of the width that each of the two panels has; the rest is for the second's labels.
PANEL = 0.4


@dataclass(frozen=True)
class Means:
    """Mean positions of a bead along one lateral axis, by plateau, from the highest z's on.

    Attributes
    ----------
    plateau, z_nm : (n,). mean_nm : (n,) from that of the highest plateau. stderr_nm : (n,) of the
        bead's thermal motion alone, nan where stiffness or friction are not known.
    """

    plateau: np.ndarray[Any, Any]
    z_nm: np.ndarray[Any, Any]
    mean_nm: np.ndarray[Any, Any]
    stderr_nm: np.ndarray[Any, Any]


def plateau_means(run: RunFolder, bead: str, name: str) -> Means | None:
    """Mean positions along an axis; None where fewer than two plateaus have them and a mean z."""
    traces = run.traces
    trace = traces[
        (traces["bead"] == bead) & (traces["axis"] == name) & (traces["stage"] == "subtracted")
    ]
    forces = run.forces[(run.forces["bead"] == bead) & (run.forces["axis"] == name)]
    thermal_pN_nm = float(thermal_energy_pN_nm(run.run["conditions"]["temperature_K"]))
    found = []
    for row in records(forces[forces["extension_nm"].notna()].sort_values("extension_nm")):
        inside = trace["time_s"].between(row["start_s"], row["start_s"] + row["duration_s"])
        if not inside.any():
            continue
        stderr = mean_stderr_nm(
            thermal_pN_nm,
            row["stiffness_pN_per_nm"],
            row["corner_frequency_hz"],
            row["duration_s"],
        )
        mean = trace.loc[inside, "mean_nm"].mean()
        found.append((row["plateau"], row["extension_nm"], mean, stderr))
    if len(found) < 2:
        return None
    plateau, z, mean, stderr = np.array(found, dtype=float).T
    return Means(plateau, z, mean - mean[-1], stderr)


def mean_stderr_nm(
    thermal_pN_nm: float, stiffness_pN_per_nm: float, corner_frequency_hz: float, duration_s: float
) -> float:
    """Standard error of the mean of a trace that is much longer than its relaxation time τ.

    Its positions scatter by kT / k, and their mean as that of T / 2τ independent ones.
    """
    relaxation_s = 1 / (2 * np.pi * corner_frequency_hz)
    return float(np.sqrt(thermal_pN_nm / stiffness_pN_per_nm * 2 * relaxation_s / duration_s))


def geometry_figure(arrays: Arrays, run: RunFolder, beads: list[str]) -> Figure:
    """A panel for x and one for y, a line for each bead; a single one in the colours of the axes.

    Up to eight beads have a colour and a sign each; more are drawn alike, named under the pointer.
    """
    alone, distinct = len(beads) == 1, len(beads) <= len(PALETTE)
    data: list[dict[str, Any]] = []
    made = layout(340, showlegend=distinct and not alone)
    for column, name in enumerate(LATERAL):
        suffix = "" if column == 0 else "2"
        for number, bead in enumerate(beads):
            means = plateau_means(run, bead, name)
            if means is None:
                continue
            colour = AXIS_COLOUR[name] if alone else PALETTE[number] if distinct else GREY
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines+markers",
                    "name": escaped(bead),
                    "legendgroup": str(number),
                    "showlegend": column == 0,
                    "x": arrays.add(means.z_nm),
                    "y": arrays.add(means.mean_nm),
                    "error_y": bars(arrays, means.stderr_nm, colour),
                    "customdata": arrays.add(means.plateau),
                    "line": {"color": colour, "width": 1},
                    "marker": {"color": colour, "size": 6}
                    | {"symbol": SYMBOLS[number % len(SYMBOLS)]},
                    "hovertemplate": f"{escaped(bead)}, plateau %{{customdata}}<br>mean z "
                    f"%{{x:.0f}} nm, mean {name} %{{y:.1f}} nm<extra></extra>",
                    "xaxis": f"x{suffix}",
                    "yaxis": f"y{suffix}",
                }
            )
        left = column * (1 - PANEL)
        made[f"xaxis{suffix}"] = axis(
            "mean z / nm", domain=[left, left + PANEL], anchor=f"y{suffix}", nticks=6
        )
        made[f"yaxis{suffix}"] = axis(f"mean {name} / nm", anchor=f"x{suffix}", zeroline=True)
    return {"data": data, "layout": made}


def measured_beads(forces: pd.DataFrame) -> list[str]:
    """Beads that have a mean z in at least two plateaus, in the order of the table."""
    seen = forces[forces["extension_nm"].notna()].groupby("bead", sort=False)["plateau"].nunique()
    return [str(bead) for bead in seen.index[seen >= 2]]
