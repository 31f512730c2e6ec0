"""The main job: a recording in, a folder of forces, curves and a report out.

Each step is a function that can be called alone; this module only calls them in order, keeps the
clock, and writes the files that `docs/run-folder.md` describes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from mtpipe.calibration.calibration import calibrate
from mtpipe.calibration.comparison import by_methods
from mtpipe.calibration.noise_floor import noise_notices
from mtpipe.calibration.quality import trace_flags
from mtpipe.calibration.recommended_force import named_forces
from mtpipe.curves.tether_curves import tether_curves
from mtpipe.diagnosis.forces_to_quote import recommended_forces
from mtpipe.diagnosis.mismatch import Examined, content, examine
from mtpipe.drift import subtract_drift
from mtpipe.ground.progress import by_name
from mtpipe.ground.types import NamedProgress
from mtpipe.ingest import load
from mtpipe.ingest.data_files import SETUP_NAME
from mtpipe.pipeline.results import Run
from mtpipe.pipeline.written import write_tables
from mtpipe.recording.recording import Recording
from mtpipe.report.marks import Mark, read_marks, without_stretches, write_marks
from mtpipe.report.run_folder import RECORDING, new_run, refuse_to_erase
from mtpipe.states import with_states
from mtpipe.tracking.stack import is_stack
from mtpipe.verdicts.diagnosed import with_diagnosis
from mtpipe.verdicts.verdict import BeadVerdict, bead_verdicts

LEFT_OUT_CODES = ("no_positions", "constant_bead")
# Of a reference bead: it moves by itself, as reading or subtraction saw it.
REFERENCE_CODES = ("moving_reference", "reference_moves")


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
    progress: NamedProgress | None = None,
) -> Run:
    """Run the whole pipeline and write its folder, which is replaced whole once all is done.

    Parameters
    ----------
    path : recording, folder of a series of files, or a setup.toml that names its files. An image
        stack is tracked first, into `recording.csv` of the folder (`mtpipe.tracking`).
    out : folder to write; an earlier run in it is replaced, a reader's marks are kept.
    setup : setup.toml; default: beside the recording.
    seed : of the posteriors and of the cross-check's simulations.
    workers : processes, over which beads are spread. More than one needs the usual guard
        `if __name__ == "__main__":` in a script that calls this.
    methods : other methods of the field (`mtpipe.METHODS`) by which each trace is calibrated too.
    cross_check : compare every bead with simulations of the configured experiment, and diagnose
        what differs.
    overwrite : even the cross-check of an earlier run by a run without one.
    progress : called with (step, done, of how many); default: a bar in a notebook.

    Raises
    ------
    MtpipeError : what a user can mend, in one sentence.
    """
    if not cross_check and not overwrite:
        refuse_to_erase(Path(out))
    with new_run(Path(out)) as fresh:
        marks = read_marks(Path(out))
        if marks:
            write_marks(fresh, marks)
        return _run(
            Path(path),
            fresh,
            setup=setup,
            seed=seed,
            workers=workers,
            methods=methods,
            cross_check=cross_check,
            marks=tuple(mark for mark in marks if mark.stretch_s is not None),
            say=by_name(progress),
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
    marks: tuple[Mark, ...],
    say: NamedProgress,
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
    raw = without_stretches(raw, marks)
    recording = subtract_drift(raw)
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
        marks,
        seed,
        started,
        dict(clock.seconds),
    )
    say("writing", 0, 1)
    write_tables(result, raw, out, _title(path, raw.name))
    write_report(out, progress=lambda done, total: say("drawing the report", done, total))
    return result


def _tracked(path: Path, out: Path, setup: Path, workers: int, say: NamedProgress) -> Path:
    """Track an image stack; the recording is in the run's folder."""
    from mtpipe.tracking.track import track

    recording = out / RECORDING
    track(path, recording, setup=setup, workers=workers, progress=say)
    return recording


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
    reasons = [f"the own motion of reference beads ({names}) is in every trace"] if names else []
    if any(notice.code == "drift_unknown" for notice in recording.notices):
        reasons.append(
            "how far the stage moved along z is unknown: errors of extensions do not include it"
        )
    return tuple(reasons)


def _title(path: Path, name: str) -> str:
    """What the report calls the recording; a plain "recording.csv" goes by its folder too."""
    if name.startswith("recording."):
        return f"{path.resolve().parent.name}/{name}"
    return name


class _Clock:
    """Seconds per step."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        now = time.perf_counter()
        self.seconds[step] = round(now - self._last, 3)
        self._last = now
