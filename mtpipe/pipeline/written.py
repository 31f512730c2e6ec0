"""What a run writes: its tables, its summary, and the identity that joins them."""

from __future__ import annotations

import io
import json
import math
import uuid
from dataclasses import asdict
from pathlib import Path

import pandas as pd

from mtpipe.curves import curve_tables
from mtpipe.ground.files import write_atomically
from mtpipe.ground.spreadsheets import as_csv
from mtpipe.ground.version import VERSION
from mtpipe.pipeline import tables, tables_crosscheck, tables_traces
from mtpipe.pipeline.results import Run
from mtpipe.pipeline.rotation import rotation_page, rotation_table
from mtpipe.recording.recording import Recording


def write_tables(result: Run, raw: Recording, out: Path, title: str) -> None:
    """Write every table and summary of a run into its folder; the report writes the CSV."""
    identity = uuid.uuid4().hex  # every file of the run carries it
    calibration = result.calibration
    forces = tables.forces_table(
        calibration, result.forces, result.flags, result.others, calibration.unbelieved
    )
    tracked = result.recording.tracked
    beads = tables.beads_table(calibration, result.forces, result.verdicts, result.curves, tracked)
    details = {
        "spectra": tables.spectra_table(calibration),
        "traces": tables_traces.traces_table(raw, result.recording),
        "drift": tables_traces.drift_table(result.recording),
        "references": tables_traces.references_table(result.recording),
        "posteriors": tables.posteriors_table(calibration),
        "force_extension": curve_tables.force_extension_table(result.curves),
        "curve_points": curve_tables.points_table(result.curves),
        "curve_stage": curve_tables.stage_table(result.curves),
        **{
            f"crosscheck_{kind}": table
            for kind, table in tables_crosscheck.crosscheck_curves(result.checked).items()
        },
    }
    for name, table in {"forces": forces, "beads": beads}.items():
        write_atomically(out / f"{name}.parquet", _parquet(table, identity))
    looks = tables_crosscheck.crosscheck_table(result.checked)
    write_atomically(out / "crosscheck.parquet", _parquet(looks, identity))
    for name, table in details.items():
        write_atomically(out / "details" / f"{name}.parquet", _parquet(table, identity))
    if result.turned:
        write_atomically(out / "rotation.csv", as_csv(rotation_table(result.turned)))
        write_atomically(out / "rotation.html", rotation_page(result.turned))
    mismatch = {**result.mismatch, "run": identity}
    text = json.dumps(mismatch, indent=2, ensure_ascii=False, allow_nan=False)
    write_atomically(out / "mismatch.json", text)
    for name, by_bead in {
        "before_after": result.before_after,
        "unexplained": result.unexplained,
    }.items():
        drawn = {"run": identity, "recording": result.recording.name, "beads": by_bead}
        text = json.dumps(drawn, ensure_ascii=False, allow_nan=False)
        write_atomically(out / "details" / f"{name}.json", text)
    write_atomically(out / "run.json", _run_json(result, title, identity))


def _parquet(table: pd.DataFrame, identity: str) -> bytes:
    """A table as a file, with the run it belongs to among the attributes that pandas keeps."""
    buffer = io.BytesIO()
    table.attrs["run"] = identity
    table.to_parquet(buffer, index=False, write_page_checksum=True)
    return buffer.getvalue()


def _run_json(result: Run, title: str, identity: str) -> str:
    recording = result.recording
    drift = recording.drift
    conditions = result.calibration.conditions
    content = {
        "run": identity,
        "version": VERSION,
        "content": result.content,
        "complete": result.complete,
        "recording": title,
        "setup": recording.setup.model_dump(mode="json", by_alias=True),
        "inputs": [asdict(file) for file in recording.files],
        "conditions": asdict(conditions),
        "drift": None
        if drift is None
        else {
            "method": drift.method,
            "cutoff_hz": drift.cutoff_hz,
            "drift_rms_nm": drift.drift_rms_nm,
            "noise_added_nm": drift.noise_added_nm,
            "left_along_z": None if drift.left_along_z is None else asdict(drift.left_along_z),
        },
        "notices": [asdict(notice) for notice in result.notices],
        "marks": [asdict(mark) for mark in result.marks],
        "seed": result.seed,
        "started": result.started,
        "seconds": result.seconds,
    }
    return json.dumps(_without_nan(content), indent=2, ensure_ascii=False, allow_nan=False)


def _without_nan(value: object) -> object:
    """JSON has no NaN: a number that does not exist is null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(item) for item in value]
    return value
