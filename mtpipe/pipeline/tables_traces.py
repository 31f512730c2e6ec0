"""Tables of traces, drift and reference beads, thinned for the report."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from mtpipe.recording.recording import AXES, Recording

TRACE_POINTS = 2000
COLUMNS = ["bead", "axis", "stage", "time_s", "low_nm", "mean_nm", "high_nm"]


def traces_table(raw: Recording, subtracted: Recording) -> pd.DataFrame:
    """`details/traces`: every tethered bead before and after drift subtraction, thinned."""
    parts = [
        stage_table(recording, bead, stage)
        for bead in raw.tethered
        for stage, recording in (("raw", raw), ("subtracted", subtracted))
    ]
    parts = [part for part in parts if len(part)]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=COLUMNS)


def stage_table(recording: Recording, bead: str, stage: str) -> pd.DataFrame:
    """Rows of `details/traces` of one bead; none of an axis that was not recorded."""
    parts = []
    for axis, name in enumerate(AXES):
        values = recording.positions_nm[bead][:, axis]
        if np.isfinite(values).any():
            part = _thinned(recording.time_s, values)
            parts.append(part.assign(bead=bead, axis=name, stage=stage)[COLUMNS])
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=COLUMNS)


def drift_table(recording: Recording) -> pd.DataFrame:
    """`details/drift`: what was subtracted, thinned; empty where nothing was."""
    drift = recording.drift
    if drift is None or drift.method != "reference" or not np.any(drift.subtracted_nm):
        return pd.DataFrame(columns=["time_s", "axis", "drift_nm"])
    parts = []
    for axis, name in enumerate(AXES):
        part = _thinned(recording.time_s, drift.subtracted_nm[:, axis])
        parts.append(
            pd.DataFrame({"time_s": part["time_s"], "axis": name, "drift_nm": part["mean_nm"]})
        )
    return pd.concat(parts, ignore_index=True)


def references_table(recording: Recording) -> pd.DataFrame:
    """`details/references`: what became of each reference bead."""
    columns = ["bead", "used", "reason"]
    columns += [f"weight_{a}" for a in AXES] + [f"noise_{a}_nm" for a in AXES]
    rows = []
    for use in recording.drift.references if recording.drift else ():
        row: dict[str, Any] = {"bead": use.bead, "used": use.used, "reason": use.reason}
        row |= {f"weight_{a}": w for a, w in zip(AXES, use.weight, strict=True)}
        row |= {f"noise_{a}_nm": n for a, n in zip(AXES, use.noise_nm, strict=True)}
        rows.append(row)
    return pd.DataFrame(rows, columns=columns)


def _thinned(time_s: np.ndarray[Any, Any], values: np.ndarray[Any, Any]) -> pd.DataFrame:
    """Minimum, mean and maximum in at most TRACE_POINTS stretches; all-lost stretches are left."""
    n = len(values)
    edges = np.unique(np.linspace(0, n, min(n, TRACE_POINTS) + 1).astype(int))
    starts = edges[:-1]
    present = np.isfinite(values)
    count = np.add.reduceat(present.astype(float), starts)
    with np.errstate(invalid="ignore"):
        mean = np.add.reduceat(np.where(present, values, 0.0), starts) / count
    low = np.minimum.reduceat(np.where(present, values, np.inf), starts)
    high = np.maximum.reduceat(np.where(present, values, -np.inf), starts)
    some = count > 0
    return pd.DataFrame(
        {
            "time_s": time_s[starts][some],
            "low_nm": low[some],
            "mean_nm": mean[some],
            "high_nm": high[some],
        }
    )
