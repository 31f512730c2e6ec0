"""Mean x and y against mean z over the plateaus: tilts and cross-talk show as slopes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.report.folder import RunFolder
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
NEEDED = ("plateau", "extension_nm", "start_s", "duration_s", "stiffness_pN_per_nm",
          "corner_frequency_hz")  # fmt: skip


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


def plateau_means(run: RunFolder) -> dict[tuple[str, str], Means]:
    """Mean positions by bead and lateral axis, of those with a mean z in at least two plateaus."""
    traces, forces = run.traces, run.forces
    lateral = traces[(traces["stage"] == "subtracted") & traces["axis"].isin(LATERAL)]
    recorded = dict(iter(lateral.groupby(["bead", "axis"])))
    placed = forces[forces["extension_nm"].notna() & forces["axis"].isin(LATERAL)]
    means: dict[tuple[str, str], Means] = {}
    for key, rows in placed.sort_values("extension_nm").groupby(["bead", "axis"], sort=False):
        trace = recorded.get(key)
        made = None if trace is None else _means(trace, rows, run.run["conditions"])
        if made is not None:
            means[str(key[0]), str(key[1])] = made
    return means


def _means(
    trace: pd.DataFrame, plateaus: pd.DataFrame, conditions: Mapping[str, Any]
) -> Means | None:
    """Means of one trace; None where fewer than two plateaus are in it."""
    thermal_pN_nm = float(thermal_energy_pN_nm(conditions["temperature_K"]))
    found = []
    rows = plateaus[list(NEEDED)].to_numpy(np.float64)
    for plateau, z, start_s, duration_s, stiffness, corner_hz in rows:
        inside = trace["time_s"].between(start_s, start_s + duration_s)
        if inside.any():
            stderr = mean_stderr_nm(thermal_pN_nm, stiffness, corner_hz, duration_s)
            found.append((plateau, z, trace.loc[inside, "mean_nm"].mean(), stderr))
    if len(found) < 2:
        return None
    number, height, mean, error = np.array(found, dtype=float).T
    return Means(number, height, mean - mean[-1], error)


def mean_stderr_nm(
    thermal_pN_nm: float, stiffness_pN_per_nm: float, corner_frequency_hz: float, duration_s: float
) -> float:
    """Standard error of the mean of a trace that is much longer than its relaxation time τ.

    Its positions scatter by kT / k, and their mean as that of T / 2τ independent ones.
    """
    relaxation_s = 1 / (2 * np.pi * corner_frequency_hz)
    return float(np.sqrt(thermal_pN_nm / stiffness_pN_per_nm * 2 * relaxation_s / duration_s))


def geometry_figure(
    arrays: Arrays, means: Mapping[tuple[str, str], Means], beads: Sequence[str]
) -> Figure:
    """A panel for x and one for y, a line for each bead; a single one in the colours of the axes.

    Up to eight beads have a colour and a sign each; more are drawn alike, named under the pointer.
    """
    beads = [bead for bead in beads if any((bead, name) in means for name in LATERAL)]
    alone, distinct = len(beads) == 1, len(beads) <= len(PALETTE)
    data: list[dict[str, Any]] = []
    made = layout(340, showlegend=distinct and not alone)
    for column, name in enumerate(LATERAL):
        suffix = "" if column == 0 else "2"
        for number, bead in enumerate(beads):
            mine = means.get((bead, name))
            if mine is None:
                continue
            colour = AXIS_COLOUR[name] if alone else PALETTE[number] if distinct else GREY
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines+markers",
                    "name": escaped(bead),
                    "legendgroup": str(number),
                    "showlegend": column == 0,
                    "x": arrays.add(mine.z_nm),
                    "y": arrays.add(mine.mean_nm),
                    "error_y": bars(arrays, mine.stderr_nm, colour),
                    "customdata": arrays.add(mine.plateau),
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
