"""The chart of a magnet's curve: forces of all beads, the curve, and what a new bead may have."""

from __future__ import annotations

from mtpipe.curves.magnet_curve.curve import MagnetCurve
from mtpipe.curves.magnet_curve.prediction import Prediction
from mtpipe.ground.types import FloatArray
from mtpipe.report.plotly_json import (
    GREY,
    INK,
    PALE,
    PALETTE,
    Arrays,
    Figure,
    axis,
    band,
    bars,
    escaped,
    layout,
    log_axis,
)


def magnet_curve_figure(
    arrays: Arrays, curve: MagnetCurve, grid_mm: FloatArray, predicted: Prediction | None
) -> Figure:
    """Forces against position; those of beads that were left out are open and in another colour.

    Parameters
    ----------
    grid_mm : (n,) positions at which the curve is drawn.
    predicted : by the magnets' field, where they are stated.
    """
    forces, middle, new = curve.forces, curve.curve(grid_mm), curve.new_bead(grid_mm)
    data = [
        band(arrays, grid_mm, new.low_pN, new.high_pN, PALE, name="a new bead, 68 %"),
        {
            "type": "scatter",
            "mode": "lines",
            "name": "curve",
            "x": arrays.add(grid_mm),
            "y": arrays.add(middle.force_pN),
            "line": {"color": INK, "width": 1.5},
        },
    ]
    if predicted is not None:
        data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": "field of [magnets]",
                "x": arrays.add(predicted.position_mm),
                "y": arrays.add(predicted.force_pN),
                "line": {"color": PALETTE[2], "width": 1.5, "dash": "dash"},
            }
        )
    for name, kept, colour, symbol in (
        ("beads", True, PALETTE[0], "circle"),
        ("left out", False, PALETTE[1], "circle-open"),
    ):
        mine = curve.kept[forces.bead] == kept
        if mine.any():
            names = [escaped(" ".join(forces.beads[n])) for n in forces.bead[mine]]
            data.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "name": name,
                    "x": arrays.add(forces.position_mm[mine]),
                    "y": arrays.add(forces.force_pN[mine]),
                    "error_y": bars(arrays, forces.stderr_pN[mine], GREY),
                    "marker": {"color": colour, "symbol": symbol, "size": 6},
                    "text": names,
                    "hovertemplate": "%{text}<br>%{x:.4g} mm: %{y:.3g} pN<extra></extra>",
                }
            )
    return {
        "data": data,
        "layout": layout(
            460,
            xaxis=axis("magnet position / mm"),
            yaxis=log_axis("force / pN", forces.force_pN),
        ),
    }
