"""The files of a magnet's curve, from the run folders of a day."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.curves.magnet_curve.curve import MagnetCurve, magnet_curve
from mtpipe.curves.magnet_curve.measured import measured_forces
from mtpipe.curves.magnet_curve.outliers import TESTS
from mtpipe.curves.magnet_curve.prediction import Prediction, beside
from mtpipe.experiment.known_force import known_force
from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.files import write_atomically
from mtpipe.ground.spreadsheets import as_csv
from mtpipe.report.magnet_curve_figure import magnet_curve_figure
from mtpipe.report.marked import read_marked_run
from mtpipe.report.plotly_json import PlainArrays
from mtpipe.report.run_folder import RUN
from mtpipe.setup.setup import Setup

TABLE, RESULT, FIGURE, TABLES = (
    "magnet_curve.csv", "magnet_curve.json", "magnet_curve.html", "magnet.toml",
)  # fmt: skip
# Sources of forces that the configured experiment is in, and so what its `[[magnet]]` says.
FROM_HEIGHTS = ("heights", "heights_alone", "named")
# Of the curve as it is drawn and tabled.
STEPS = 101


def runs_below(folder: Path) -> dict[str, Path]:
    """Run folders below a folder, by their path below it; hidden ones are not looked into."""
    found = {}
    for file in sorted(folder.rglob(RUN)):
        name = file.parent.relative_to(folder)
        if not any(part.startswith(".") for part in name.parts):
            found[name.as_posix()] = file.parent
    return found


def write_magnet_curve(out: Path, runs: Mapping[str, Path]) -> str:
    """Fit the curve to runs as their marks leave them, write its files, and say it in a sentence.

    Raises
    ------
    MtpipeError : too little is there for a curve, or a run cannot be read. No file is left then.
    """
    for name in (TABLE, RESULT, FIGURE, TABLES):
        (out / name).unlink(missing_ok=True)
    read = {name: read_marked_run(folder) for name, folder in runs.items()}
    own = {name: own_forces(run.forces, run.setup) for name, run in read.items()}
    curve = magnet_curve(measured_forces(own.items()))
    positions = curve.forces.only(curve.kept).positions_mm
    grid = np.linspace(positions[0], positions[-1], STEPS)
    predicted, beside_it = _predicted(curve, [run.setup for run in read.values()], grid)
    write_atomically(out / TABLE, as_csv(_table(curve, grid, predicted)))
    write_atomically(out / TABLES, _magnet_tables(curve, positions))
    write_atomically(out / FIGURE, _page(curve, grid, predicted))
    stated = sum(len(run.forces) - len(own[name]) for name, run in read.items())
    said = " ".join(one for one in (sentence(curve), _left_out(stated), beside_it) if one)
    write_atomically(out / RESULT, json.dumps(_result(curve, said), indent=2) + "\n")
    return said


def own_forces(forces: pd.DataFrame, setup: Setup) -> pd.DataFrame:
    """Rows of a forces table without those in which a force of `[[magnet]]` is already.

    The spectra's forces do not know of it. What comes of heights does, at that position.
    """
    states = {
        at: known_force(setup, None if pd.isna(at) else float(at)) is not None
        for at in forces["magnet_mm"].unique()
    }
    rests = forces["magnet_mm"].map(states) & forces["force_source"].isin(FROM_HEIGHTS)
    return forces[~rests.astype(bool)]


def _left_out(rows: int) -> str:
    if not rows:
        return ""
    return (
        "Forces that rest on those of [[magnet]] are left out, as these are of a curve themselves."
    )


def _predicted(
    curve: MagnetCurve, setups: Sequence[Setup], grid: np.ndarray[Any, Any]
) -> tuple[Prediction | None, str]:
    """What the `[magnets]` of all setups predict, and the sentence about it."""
    stated = {(one.magnets, one.beads.radius_nm) for one in setups if one.magnets is not None}
    if not stated:
        return None, ""
    if len(stated) > 1:
        return None, "The setups state different [magnets] or radii: no force is predicted."
    magnets, radius = stated.pop()
    try:
        found = beside(curve, magnets, radius, grid)
    except MtpipeError as error:
        return None, f"Of [magnets] nothing is predicted: {error}."
    return found, found.sentence


def sentence(curve: MagnetCurve) -> str:
    """The curve in words."""
    left = int((~curve.kept).sum())
    fit = curve.fit
    said = (
        f"The magnet's curve is a {fit.form.name}, of {int(curve.kept.sum())} beads. From bead to "
        f"bead forces differ by {fit.spread:.1%} ({fit.spread_low:.1%} to {fit.spread_high:.1%})."
    )
    if left:
        said += f" {left} {'beads are' if left > 1 else 'bead is'} unlike the others and left out."
    if curve.error_factor > 1:
        said += f" Forces scatter {curve.error_factor:.2g} times as much as their errors say."
    return said


def _table(
    curve: MagnetCurve, grid: np.ndarray[Any, Any], predicted: Prediction | None
) -> pd.DataFrame:
    middle, new = curve.curve(grid), curve.new_bead(grid)
    return pd.DataFrame(
        {
            "position_mm": grid,
            "force_pN": middle.force_pN,
            "stderr_pN": middle.stderr_pN,
            "low_pN": middle.low_pN,
            "high_pN": middle.high_pN,
            "new_bead_low_pN": new.low_pN,
            "new_bead_high_pN": new.high_pN,
            "predicted_pN": np.nan if predicted is None else predicted.force_pN,
            "predicted_stderr_pN": np.nan if predicted is None else predicted.stderr_pN,
        }
    )


def _magnet_tables(curve: MagnetCurve, positions: np.ndarray[Any, Any]) -> str:
    """`[[magnet]]` of a setup: forces on a bead of which nothing is known yet."""
    new = curve.new_bead(positions)
    lines = [
        "# From mtpipe magnet-curve. The errors hold for a new bead: its own factor is in them."
    ]
    for position, force, stderr in zip(positions, new.force_pN, new.stderr_pN, strict=True):
        lines += [
            "", "[[magnet]]", f"position_mm = {float(position)!r}",
            f"force_pN = {float(f'{force:.6g}')!r}",
            f"force_pN_stderr = {float(f'{stderr:.3g}')!r}",
        ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _result(curve: MagnetCurve, said: str) -> dict[str, Any]:
    fit = curve.fit
    errors = np.sqrt(np.diag(fit.covariance))
    named = zip(fit.form.parameters, fit.theta, errors, fit.form.units, strict=True)
    factor, stderr = curve.factors()
    beads = [
        {
            "recording": recording,
            "bead": bead,
            "forces": int((curve.forces.bead == n).sum()),
            "log_factor": float(factor[n]),
            "log_factor_stderr": float(stderr[n]),
            "p_values": dict(zip(TESTS, map(float, curve.p_values[n]), strict=True)),
            "left_out": curve.reason(n),
        }
        for n, (recording, bead) in enumerate(curve.forces.beads)
    ]
    return {
        "schema": "mtpipe.magnet_curve/1",
        "sentence": said,
        "form": fit.form.name,
        "origin_mm": fit.origin_mm,
        "sign": fit.sign,
        "parameters": {
            name: {"value": float(value), "stderr": float(error), "unit": unit}
            for name, value, error, unit in named
        },
        "bic": dict(curve.bic),
        "spread": {"value": fit.spread, "low": fit.spread_low, "high": fit.spread_high},
        "error_factor": curve.error_factor,
        "outliers": [one for one in beads if one["left_out"]],
        "beads": beads,
    }


def _page(curve: MagnetCurve, grid: np.ndarray[Any, Any], predicted: Prediction | None) -> str:
    import plotly.graph_objects as go

    page: str = go.Figure(magnet_curve_figure(PlainArrays(), curve, grid, predicted)).to_html()
    return page


def told_magnet_curve(out: Path, runs: Mapping[str, Path]) -> str:
    """As `write_magnet_curve`; why there is no curve, where there is none."""
    try:
        return write_magnet_curve(out, runs)
    except MtpipeError as error:
        return f"There is no curve of the magnet: {error}."
