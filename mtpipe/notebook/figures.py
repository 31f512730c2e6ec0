"""A figure for each kind of result, drawn by the functions that draw the report.

`Shown.plot` asks for `figure_of` by name. What a report reads from a run's tables is made here
from the result by the functions that make those tables.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pandas as pd

from mtpipe.calibration.calibration import Calibration
from mtpipe.crosschecking.crosscheck import CrossCheck
from mtpipe.curves.curve_tables import force_extension_table
from mtpipe.curves.extension_curve import ForceExtension
from mtpipe.curves.shared_fit import SharedFit
from mtpipe.diagnosis.before_after import content_of
from mtpipe.diagnosis.mismatch import Mismatch
from mtpipe.fit.posterior import Posterior
from mtpipe.fit.trace import TraceFit
from mtpipe.ground.errors import MtpipeError
from mtpipe.pipeline.results import Run
from mtpipe.pipeline.tables import forces_table
from mtpipe.pipeline.tables_traces import stage_table
from mtpipe.recording.recording import Recording
from mtpipe.report.figures_bead import force_extension_figure, traces_figure
from mtpipe.report.figures_before_after import spectra_figure
from mtpipe.report.figures_crosscheck import map_figure
from mtpipe.report.figures_run import forces_figure
from mtpipe.report.figures_trace import posterior_figure, spectrum_figure
from mtpipe.report.plateau_forces import quoted
from mtpipe.report.plotly_json import (
    PALETTE,
    SYMBOLS,
    Figure,
    PlainArrays,
    axis,
    bars,
    escaped,
    layout,
    log_axis,
)
from mtpipe.report.rows_crosscheck import crosscheck_rows

if TYPE_CHECKING:
    import plotly.graph_objects as go

T = TypeVar("T")


def figure_of(result: Any, **choice: Any) -> go.Figure:
    """The figure of a result.

    Parameters
    ----------
    choice : `bead` of results with several; `axis` ("x", "y" or "z") gives the colour of a trace.

    Raises
    ------
    MtpipeError : there is no such bead.
    TypeError : a choice that this result does not have.
    """
    import plotly.graph_objects as go

    return go.Figure(_drawn(result, **choice))


@singledispatch
def _drawn(result: Any, **choice: Any) -> Figure:
    raise TypeError(f"there is no figure of a {type(result).__name__}")


@_drawn.register
def _trace_fit(fit: TraceFit, axis: str = "x") -> Figure:
    gain = fit.spectrum.gain
    table = pd.DataFrame(
        {
            "frequency_hz": fit.spectrum.frequency_hz,
            "ordinates": fit.spectrum.ordinates,
            "power_nm2_per_hz": fit.spectrum.power / gain,
            "model_nm2_per_hz": fit.expected_power / gain,
        }
    )
    return spectrum_figure(PlainArrays(), table, axis)


@_drawn.register
def _posterior(posterior: Posterior, axis: str = "x") -> Figure:
    table = pd.DataFrame(
        {
            "stiffness_pN_per_nm": posterior.stiffness_pN_per_nm,
            "friction_pN_s_per_nm": posterior.friction_pN_s_per_nm,
            "force_pN": np.nan,
        }
    )
    return posterior_figure(PlainArrays(), table, axis)


@_drawn.register
def _recording(recording: Recording, bead: str | None = None) -> Figure:
    name, _ = _chosen(recording.positions_nm, bead or next(iter(recording.tethered), None))
    stage = "raw" if recording.drift is None else "subtracted"
    table = stage_table(recording, name, stage)
    return traces_figure(PlainArrays(), table, recording.table)


@_drawn.register
def _calibration(calibration: Calibration) -> Figure:
    table = calibration.table
    forces = table[table["force_pN"].notna()]
    return forces_figure(PlainArrays(), forces, [bead.bead for bead in calibration.beads])


@_drawn.register
def _run(run: Run) -> Figure:
    """Forces to quote of all beads."""
    table = forces_table(run.calibration, run.forces, run.flags)
    return forces_figure(
        PlainArrays(), quoted(table), [bead.bead for bead in run.calibration.beads]
    )


@_drawn.register
def _force_extension(curve: ForceExtension) -> Figure:
    fits = force_extension_table({curve.bead: curve})
    return force_extension_figure(PlainArrays(), curve.table, fits, curve.assay)


@_drawn.register
def _shared_fit(fit: SharedFit) -> Figure:
    """Every bead's points and the curve that the fit expects of it."""
    arrays, data = PlainArrays(), []
    for number, (bead, points) in enumerate(fit.points.items()):
        colour = PALETTE[number % len(PALETTE)]
        here = {"type": "scatter", "legendgroup": bead}
        data.append(
            here
            | {
                "mode": "markers",
                "name": escaped(bead),
                "x": arrays.add(points.extension_nm),
                "y": arrays.add(points.force_pN),
                "error_x": bars(arrays, points.extension_stderr_nm, colour),
                "error_y": bars(arrays, points.force_stderr_pN, colour),
                "marker": {"color": colour, "symbol": SYMBOLS[number % len(SYMBOLS)], "size": 8},
            }
        )
        if len(points):
            grid = np.geomspace(points.force_pN.min(), points.force_pN.max(), 80)
            line = {"x": arrays.add(fit.extension_nm(bead, grid)), "y": arrays.add(grid)}
            drawn = {"mode": "lines", "showlegend": False, "line": {"color": colour}}
            data.append(here | line | drawn)
    seen = np.concatenate([points.force_pN for points in fit.points.values()])
    made = layout(380, xaxis=axis("mean extension / nm"), yaxis=log_axis("force / pN", seen))
    return {"data": data, "layout": made}


@_drawn.register
def _crosscheck(checked: CrossCheck, bead: str | None = None) -> Figure:
    name, _ = _chosen(checked.beads, bead)
    table = checked.table
    return map_figure(crosscheck_rows(table[table["bead"] == name]))


@_drawn.register
def _mismatch(mismatch: Mismatch, bead: str | None = None) -> Figure:
    """Spectra without and with what was named; where nothing was, the map of the cross-check."""
    name, found = _chosen(mismatch.beads, bead)
    named = content_of(found)
    if named is None:
        return _crosscheck(mismatch.crosscheck, name)
    return spectra_figure(PlainArrays(), named)


def _chosen(beads: Mapping[str, T], bead: str | None) -> tuple[str, T]:
    """The bead asked for, or the first."""
    name = next(iter(beads), None) if bead is None else bead
    if name is None or name not in beads:
        there = ", ".join(beads) or "none"
        what = "there is no bead to draw" if name is None else f"there is no bead {name} to draw"
        raise MtpipeError(what, mend=f"Beads that can be drawn: {there}.")
    return name, beads[name]
