"""The charts of one bead: force–extension curve and traces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from mtpipe.fit.points import Assay
from mtpipe.fit.tether import expected_extension_nm
from mtpipe.ground.types import FloatArray
from mtpipe.physics.tether import VALIDITY, Chain
from mtpipe.report import words
from mtpipe.report.folder import records
from mtpipe.report.plotly_json import (
    AXIS_COLOUR,
    INK,
    PLATEAU,
    QUOTED_COLOUR,
    Arrays,
    Figure,
    axis,
    band,
    bars,
    layout,
    log_axis,
    note,
    positive,
    with_gaps,
)

MODEL_DASH = {"marko-siggia": "dash", "bouchiat": "solid", "extensible": "dashdot"}
MODEL_COLOUR = {"marko-siggia": "#cc79a7", "bouchiat": INK, "extensible": "#009e73"}

# A plateau shorter than this share of the recording has no number in the figure of traces.
LEAST_LABELLED = 0.03


def force_extension_figure(
    arrays: Arrays, forces: pd.DataFrame, fits: pd.DataFrame, assay: Assay
) -> Figure:
    """Force to quote against extension with every model: thick where fitted, thin elsewhere.

    Parameters
    ----------
    forces : of one bead, a row per plateau: `plateau`, and force and extension with errors.
    fits : of this bead, as `details/force_extension` has them.
    """
    forces = forces[forces["extension_nm"].notna()]
    data: list[dict[str, Any]] = []
    if len(forces):
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": "force to quote",
                "x": arrays.add(forces["extension_nm"]),
                "y": arrays.add(forces["force_pN"]),
                "error_x": bars(arrays, forces["extension_stderr_nm"], QUOTED_COLOUR),
                "error_y": bars(arrays, forces["force_stderr_pN"], QUOTED_COLOUR),
                "customdata": arrays.add(forces["plateau"]),
                "marker": {"color": QUOTED_COLOUR, "size": 8},
                "hovertemplate": "plateau %{customdata}<br>%{x:.1f} nm, %{y:.3g} pN<extra></extra>",
            }
        )
    seen = positive(forces["force_pN"])
    if len(seen):
        grid = np.geomspace(seen.min() / 1.5, seen.max() * 1.5, 80)
        for fit in records(fits):
            data += _model_lines(arrays, fit, assay, grid)
    return {
        "data": data,
        "layout": layout(
            380,
            xaxis=axis("mean extension / nm"),
            yaxis=log_axis("force / pN", seen),
        ),
    }


def traces_figure(arrays: Arrays, table: pd.DataFrame, plateaus: pd.DataFrame) -> Figure:
    """Traces before (left) and after drift subtraction (right), on the same scales.

    Parameters
    ----------
    table : of one bead, as `details/traces` has them.
    plateaus : a row each: `plateau`, `start_s`, `duration_s`.
    """
    stages = [s for s in ("raw", "subtracted") if (table["stage"] == s).any()]
    width = 1 / max(len(stages), 1)
    made = layout(640, showlegend=False, shapes=[], annotations=[])
    made["margin"]["t"] = 48
    data: list[dict[str, Any]] = []
    for column, stage in enumerate(stages):
        left, right = column * width + 0.02 * column, (column + 1) * width - 0.02 * (1 - column)
        for line, name in enumerate("xyz"):
            number = 3 * column + line + 1
            suffix = "" if number == 1 else str(number)
            trace = table[(table["stage"] == stage) & (table["axis"] == name)]
            trace = trace.sort_values("time_s")
            t, low, mean, high = with_gaps(
                *(trace[c].to_numpy(np.float64) for c in ("time_s", "low_nm", "mean_nm", "high_nm"))
            )
            on = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
            colour = AXIS_COLOUR[name]
            data += [
                band(arrays, t, low, high, _pale(colour), **on),
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": arrays.add(t),
                    "y": arrays.add(mean),
                    "line": {"color": colour, "width": 1},
                    "hovertemplate": f"%{{x:.2f}} s: mean {name} %{{y:.1f}} nm<extra></extra>",
                    **on,
                },
            ]
            top = 1 - line * 0.345
            ties = {} if number == 1 else {"matches": "x"}
            made[f"xaxis{suffix}"] = axis(
                "time / s" if line == 2 else "",
                domain=[left, right],
                anchor=f"y{suffix}",
                showticklabels=line == 2,
                **ties,
            )
            made[f"yaxis{suffix}"] = axis(
                f"{name} / nm" if column == 0 else "",
                domain=[top - 0.31, top],
                anchor=f"x{suffix}",
                showticklabels=column == 0 and bool(np.isfinite(mean).any()),
                **({"matches": f"y{line + 1 if line else ''}"} if column else {}),
            )
            if not np.isfinite(mean).any():
                made["annotations"].append(
                    note(
                        f"{name} was not recorded",
                        xref=f"x{suffix} domain",
                        yref=f"y{suffix} domain",
                    )
                )
        title = {"raw": "as recorded", "subtracted": "after drift subtraction"}[stage]
        made["annotations"].append(
            {"text": title, "xref": "paper", "yref": "paper", "x": left, "y": 1.0}
            | {"showarrow": False, "xanchor": "left", "yanchor": "bottom", "yshift": 18}
        )
    narrow_s = LEAST_LABELLED * (table["time_s"].max() - table["time_s"].min())
    made["shapes"] = [
        {"type": "rect", "layer": "below", "line": {"width": 0}, "fillcolor": PLATEAU}
        | {"xref": f"x{4 if column else ''}", "yref": "paper", "y0": 0, "y1": 1}
        | {"x0": row["start_s"], "x1": row["start_s"] + row["duration_s"]}
        | {
            "label": {
                # the numbers of many short plateaus would cover one another
                "text": str(int(row["plateau"])) if row["duration_s"] > narrow_s else "",
                "textposition": "top center",
                "yanchor": "bottom",
            }
        }
        for column in range(len(stages))
        for row in records(plateaus)
    ]
    return {"data": data, "layout": made}


def _model_lines(
    arrays: Arrays, fit: dict[str, Any], assay: Assay, grid: FloatArray
) -> list[dict[str, Any]]:
    model = fit["model"]
    if not (
        words.is_number(fit["contour_length_nm"]) and words.is_number(fit["persistence_length_nm"])
    ):
        return []
    modulus = fit["stretch_modulus_pN"] if model == "extensible" else None
    if modulus is not None and not words.is_number(modulus):
        return []
    chain = Chain(
        fit["contour_length_nm"], fit["persistence_length_nm"], assay.temperature_K, model, modulus
    )
    name = words.MODEL[model] + (" (recommended)" if fit["recommended"] else "")
    inside = np.geomspace(fit["force_low_pN"], fit["force_high_pN"], 60)
    line = {"color": MODEL_COLOUR[model], "dash": MODEL_DASH[model]}
    common = {"type": "scatter", "mode": "lines", "legendgroup": model}
    offset = fit["offset_nm"]
    hover = f"{words.MODEL[model]}: %{{x:.1f}} nm, %{{y:.3g}} pN<extra></extra>"
    return [
        common
        | {
            "name": name,
            **_as_measured(arrays, expected_extension_nm(chain, inside, assay), inside, offset),
            "line": line | {"width": 2.2 if fit["recommended"] else 1.6},
            "hovertemplate": hover,
        },
        common
        | {
            "showlegend": False,
            **_as_measured(arrays, expected_extension_nm(chain, grid, assay), grid, offset),
            "line": line | {"width": 0.6},
            "hovertemplate": hover,
        },
    ]


def _as_measured(
    arrays: Arrays, extension_nm: FloatArray, force_pN: FloatArray, offset_nm: float
) -> dict[str, Any]:
    """A curve where the points are: z = 0 may be off, and forces are in proportion to z."""
    measured = extension_nm - offset_nm
    seen = measured > 0
    force = force_pN * measured / extension_nm
    return {"x": arrays.add(measured[seen]), "y": arrays.add(force[seen])}


def valid_range(model: str) -> tuple[str, str]:
    """Forces for which a model describes DNA, and the reason."""
    valid = VALIDITY[model]  # type: ignore[index]
    low, high = valid.force_range_pN
    shown = f"up to {words.number(high)}" if low == 0 else words.span(low, high)
    return shown, valid.reason


def _pale(colour: str) -> str:
    return f"rgba({int(colour[1:3], 16)},{int(colour[3:5], 16)},{int(colour[5:7], 16)},0.28)"
