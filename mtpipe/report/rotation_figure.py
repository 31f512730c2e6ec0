"""The chart of beads that were turned: extension against turns, and what each tether is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtpipe.curves.rotation.beads import TurnedBead
from mtpipe.report.plotly_json import PALETTE, Arrays, Figure, axis, escaped, layout


def rotation_figure(arrays: Arrays, beads: Sequence[TurnedBead]) -> Figure:
    """Points and best fit of every bead and stretch, named with its verdict."""
    data = []
    for number, one in enumerate(beads):
        colour, turned = PALETTE[number % len(PALETTE)], one.turned
        force = f" at {one.force_pN:.2g} pN" if one.force_pN > 0 else ""
        name = f"{escaped(turned.bead)}{force}: {one.verdict.verdict}"
        order = np.argsort(turned.turns, kind="stable")
        group = {"type": "scatter", "legendgroup": str(number)}
        data += [
            group
            | {
                "mode": "markers",
                "name": name,
                "x": arrays.add(turned.turns),
                "y": arrays.add(turned.extension_nm),
                "marker": {"color": colour, "size": 5},
                "hovertemplate": f"{name}<br>%{{x:.1f}} turns: %{{y:.0f}} nm<extra></extra>",
            },
            group
            | {
                "mode": "lines",
                "showlegend": False,
                "x": arrays.add(turned.turns[order]),
                "y": arrays.add(one.verdict.fitted_nm[order]),
                "line": {"color": colour, "width": 1.5},
                "hoverinfo": "skip",
            },
        ]
    made = layout(460, xaxis=axis("turns of the magnets"), yaxis=axis("extension / nm"))
    return {"data": data, "layout": made}
