"""The main job: a recording in, a folder of forces, curves and a report out.

Each step is a function that can be called alone; this module only calls them in order, keeps the
clock, and writes the files that `docs/run-folder.md` describes.
"""

from __future__ import annotations

import io
import json
import math
import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

import mtpipe
from mtpipe.calibration.calibration import Calibration, calibrate
from mtpipe.calibration.comparison import MethodResult, by_methods
from mtpipe.calibration.noise_floor import noise_notices
from mtpipe.calibration.quality import trace_flags
from mtpipe.calibration.recommended_force import BeadForces, named_forces
from mtpipe.crosschecking.crosscheck import CrossCheck
from mtpipe.curves.extension_curve import ForceExtension
from mtpipe.curves.tether_curves import tether_curves
from mtpipe.diagnosis.forces_to_quote import recommended_forces
from mtpipe.diagnosis.mismatch import Examined, content, examine
from mtpipe.drift import subtract_drift
from mtpipe.effects.catalogue import catalogue
from mtpipe.experiment.known_force import known_force_notices
from mtpipe.ground.files import write_atomically
from mtpipe.ground.notice import Notice
from mtpipe.ground.spreadsheets import as_csv
from mtpipe.ingest import load
from mtpipe.ingest.data_files import SETUP_NAME
from mtpipe.ingest.surface import put_surface_at_zero
from mtpipe.pipeline import tables
from mtpipe.recording.recording import Recording
from mtpipe.report.run_folder import RECORDING, new_run, refuse_to_erase
from mtpipe.states import with_states
from mtpipe.tracking.stack import is_stack
from mtpipe.verdicts.diagnosed import with_diagnosis
from mtpipe.verdicts.verdict import BeadVerdict, bead_verdicts

Progress = Callable[[str, int, int], None]
LEFT_OUT_CODES = ("no_positions", "constant_bead")
# Of a reference bead: it moves by itself, as reading or subtraction saw it.
REFERENCE_CODES = ("moving_reference", "reference_moves")


@dataclass(frozen=True)
class Run:
    """Everything a run found out.

    `forces` are the forces to quote, of each tethered bead. `others` are forces by other methods,
    where asked for. `flags` are per bead, about its traces; `curves` exist for beads with enough
    forces; `checked` is the cross-check, unless left out; `mismatch`, `before_after` and
    `unexplained` are the content of the diagnosis's files.
    """

    recording: Recording
    calibration: Calibration
    forces: dict[str, BeadForces]
    others: tuple[MethodResult, ...]
    flags: dict[str, tuple[Notice, ...]]
    verdicts: tuple[BeadVerdict, ...]
    curves: dict[str, ForceExtension]
    checked: CrossCheck | None
    mismatch: dict[str, Any]
    before_after: dict[str, dict[str, Any]]
    unexplained: dict[str, dict[str, Any]]
    seed: int
    started: str
    seconds: dict[str, float]

    @property
    def notices(self) -> tuple[Notice, ...]:
        """All notices, in the order in which they arose."""
        flags = [notice for bead in self.flags.values() for notice in bead]
        curves = [notice for curve in self.curves.values() for notice in curve.notices]
        refused = {} if self.checked is None else self.checked.refused
        unchecked = [
            Notice("not_crosschecked", "info", f"It was not cross-checked: {reason}", bead)
            for bead, reason in refused.items()
        ]
        setup, positions = self.recording.setup, [p.magnet_mm for p in self.recording.plateaus]
        beyond = []
        if self.checked is not None:
            beyond = [
                *not_simulated(setup.model.effects),
                *known_force_notices(setup, positions),
            ]
        return (
            *self.recording.notices,
            *self.calibration.notices,
            *flags,
            *curves,
            *unchecked,
            *beyond,
        )


def run(
    path: Path | str,
    out: Path | str,
    *,
    setup: Path | str | None = None,
    seed: int = 0,
    workers: int = 1,
    methods: Sequence[str] = (),
    cross_check: bool = True,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Run:
    """Run the whole pipeline and write its folder, which is replaced whole once all is done.

    Parameters
    ----------
    path : recording, folder of a series of files, or a setup.toml that names its files. An image
        stack is tracked first, into `recording.csv` of the folder (`mtpipe.tracking`).
    out : folder to write; an earlier run in it is replaced.
    setup : setup.toml; default: beside the recording.
    seed : of the posteriors and of the cross-check's simulations.
    workers : processes, over which beads are spread. More than one needs the usual guard
        `if __name__ == "__main__":` in a script that calls this.
    methods : other methods of the field (`mtpipe.METHODS`) by which each trace is calibrated too.
    cross_check : compare every bead with simulations of the configured experiment, and diagnose
        what differs.
    overwrite : even the cross-check of an earlier run by a run without one.
    progress : called with (step, done, of how many).

    Raises
    ------
    MtpipeError : what a user can mend, in one sentence.
    """
    if not cross_check and not overwrite:
        refuse_to_erase(Path(out))
    with new_run(Path(out)) as fresh:
        return _run(
            Path(path),
            fresh,
            setup=setup,
            seed=seed,
            workers=workers,
            methods=methods,
            cross_check=cross_check,
            say=progress or (lambda step, done, total: None),
        )


def _run(
    path: Path,
    out: Path,
    *,
    setup: Path | str | None,
    seed: int,
    workers: int,
    methods: Sequence[str],
    cross_check: bool,
    say: Progress,
) -> Run:
    from mtpipe.report import write_report

    started = datetime.now(UTC).isoformat(timespec="seconds")
    clock = _Clock()
    if is_stack(path, None if setup is None else Path(setup)):
        setup = (path if path.is_dir() else path.parent) / SETUP_NAME if setup is None else setup
        recording_file = _tracked(path, out, Path(setup), workers, say)
        clock.lap("track")
        raw = replace(load(recording_file, setup), name=path.name)
    else:
        say("reading", 0, 1)
        raw = load(path, setup)
    clock.lap("read")
    say("subtracting drift", 0, 1)
    # the stretch in which beads touch the surface tells z = 0 better once the stage stands still
    recording = put_surface_at_zero(subtract_drift(raw))
    clock.lap("drift")
    say("testing plateaus", 0, 1)
    recording = with_states(recording)
    clock.lap("states")
    beads = len(recording.tethered)
    say("calibrating beads", 0, beads)
    calibration = calibrate(
        recording,
        seed=seed,
        workers=workers,
        progress=lambda done, total: say("calibrating beads", done, total),
    )
    clock.lap("calibrate")
    others = by_methods(calibration, methods)
    examined: Examined | None = None
    if cross_check:
        examined = examine(
            recording,
            seed=seed,
            workers=workers,
            progress=lambda done, total: say("cross-checking beads", done, total),
        )
        clock.lap("crosscheck")
    found = {} if examined is None else examined.found
    forces = recommended_forces(calibration, found)
    say("fitting tethers", 0, beads)
    curves = tether_curves(calibration, named_forces(forces))
    clock.lap("force-extension")
    flags = {
        bead.bead: (
            *(
                notice
                for plateau in bead.plateaus
                for notice in trace_flags(calibration, bead, plateau, recording.setup)
            ),
            *noise_notices(bead, recording),
        )
        for bead in calibration.beads
    }
    verdicts = bead_verdicts(
        calibration, flags, curves, recording.setup, _reference_warnings(recording), found
    ) + _left_out(recording)
    tolerance = recording.setup.report.tolerance
    verdicts = tuple(
        with_diagnosis(one, forces.get(one.bead), found.get(one.bead), tolerance)
        for one in verdicts
    )
    result = Run(
        recording,
        calibration,
        forces,
        others,
        flags,
        verdicts,
        curves,
        None if examined is None else examined.checked,
        content(recording.name, found, forces, tolerance),
        {} if examined is None else examined.before_after,
        {} if examined is None else examined.unexplained,
        seed,
        started,
        dict(clock.seconds),
    )
    say("writing", 0, 1)
    _write_tables(result, raw, out, _title(path, raw.name))
    write_report(out, progress=lambda done, total: say("drawing the report", done, total))
    return result


def _tracked(path: Path, out: Path, setup: Path, workers: int, say: Progress) -> Path:
    """Track an image stack; the recording is in the run's folder."""
    from mtpipe.tracking.track import track

    recording = out / RECORDING
    track(path, recording, setup=setup, workers=workers, progress=say)
    return recording


def not_simulated(listed: Sequence[str]) -> list[Notice]:
    """What is to be said where the setup lists effects that no fit and no simulation has."""
    known = {effect.name for effect in catalogue()}
    names = [name for name in listed if name not in known]
    if "anharmonic_tether" in listed and "rotation_coupling" not in listed:
        # only a bead that turns is followed through the whole potential
        names.append("anharmonic_tether without rotation_coupling")
    if not names:
        return []
    return [
        Notice(
            "effects_not_simulated",
            "caution",
            f"The setup lists {', '.join(names)}, which the simulations of the cross-check do not "
            "have: what such an effect does counts as a difference.",
        )
    ]


def _left_out(recording: Recording) -> tuple[BeadVerdict, ...]:
    """Beads that the files name and that reading left out, each with its reason."""
    return tuple(
        BeadVerdict(notice.bead, "refused", (notice.message,))
        for notice in recording.notices
        if notice.code in LEFT_OUT_CODES
        and notice.bead is not None
        and notice.bead not in recording.positions_nm
        and notice.bead not in recording.setup.beads.reference
    )


def _reference_warnings(recording: Recording) -> tuple[str, ...]:
    """What the reference beads leave in every trace, or its size unknown, in words.

    Nothing of references that were left out.
    """
    uses = recording.drift.references if recording.drift else ()
    subtracted = {one.bead for one in uses if one.used}
    faulty = {
        notice.bead
        for notice in recording.notices
        if notice.code in REFERENCE_CODES and notice.bead in subtracted
    }
    names = ", ".join(sorted(name for name in faulty if name is not None))
    reasons = [f"reference motion of its own ({names}) is in every trace"] if names else []
    if any(notice.code == "drift_unknown" for notice in recording.notices):
        reasons.append("how far the stage moved along z is unknown: errors of extensions lack it")
    return tuple(reasons)


def _title(path: Path, name: str) -> str:
    """What the report calls the recording; a plain "recording.csv" goes by its folder too."""
    if name.startswith("recording."):
        return f"{path.resolve().parent.name}/{name}"
    return name


def _write_tables(result: Run, raw: Recording, out: Path, title: str) -> None:
    identity = uuid.uuid4().hex  # every file of the run carries it
    calibration = result.calibration
    forces = tables.forces_table(
        calibration, result.forces, result.flags, result.others, calibration.unbelieved
    )
    tracked = result.recording.tracked
    beads = tables.beads_table(calibration, result.forces, result.verdicts, result.curves, tracked)
    details = {
        "spectra": tables.spectra_table(calibration),
        "traces": tables.traces_table(raw, result.recording),
        "drift": tables.drift_table(result.recording),
        "references": tables.references_table(result.recording),
        "posteriors": tables.posteriors_table(calibration),
        "force_extension": tables.force_extension_table(result.curves),
        **{
            f"crosscheck_{kind}": table
            for kind, table in tables.crosscheck_curves(result.checked).items()
        },
    }
    for name, table in {"forces": forces, "beads": beads}.items():
        write_atomically(out / f"{name}.parquet", _parquet(table, identity))
        write_atomically(out / f"{name}.csv", as_csv(table))
    looks = tables.crosscheck_table(result.checked)
    write_atomically(out / "crosscheck.parquet", _parquet(looks, identity))
    for name, table in details.items():
        write_atomically(out / "details" / f"{name}.parquet", _parquet(table, identity))
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
        "version": mtpipe.__version__,
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


class _Clock:
    """Seconds per step."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        now = time.perf_counter()
        self.seconds[step] = round(now - self._last, 3)
        self._last = now
