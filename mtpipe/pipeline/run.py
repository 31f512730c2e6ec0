"""The main job: a recording in, a folder of forces, curves and a report out.

Each step is a function that can be called alone; this module only calls them in order, keeps the
clock, and writes the files that `docs/run-folder.md` describes. A batch (`pipeline.batch`) is many
of these.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from mtpipe.calibration.calibration import Calibration, calibrating
from mtpipe.calibration.comparison import MethodResult, by_methods
from mtpipe.calibration.noise_floor import noise_notices
from mtpipe.calibration.quality import trace_flags
from mtpipe.calibration.recommended_force import named_forces
from mtpipe.curves.rotation.beads import TurnedBead, turning
from mtpipe.curves.tether_curves import tether_curves
from mtpipe.diagnosis.forces_to_quote import recommended_forces
from mtpipe.diagnosis.mismatch import Examined, examining
from mtpipe.diagnosis.mismatch import content as content_of_mismatch
from mtpipe.drift import subtract_drift
from mtpipe.ground.enduring import enduring_executor
from mtpipe.ground.journal import Kept
from mtpipe.ground.progress import by_name
from mtpipe.ground.steps import Steps, finished
from mtpipe.ground.types import NamedProgress
from mtpipe.ingest import load
from mtpipe.pipeline.identity import Asked, identity
from mtpipe.pipeline.results import Run
from mtpipe.pipeline.verdict import BeadVerdict, bead_verdicts
from mtpipe.pipeline.verdict_diagnosed import with_diagnosis
from mtpipe.pipeline.written import write_tables
from mtpipe.recording.recording import Recording
from mtpipe.report.marks import read_marks, without_stretches, write_marks
from mtpipe.report.run_folder import (
    RECORDING,
    clear_journals,
    journal,
    make_ready,
    new_run,
    refuse_to_erase,
    told,
)
from mtpipe.states import with_states

# Names of steps from whose progress beads are counted.
KEPT_BEADS, CHECKED_BEADS = "beads kept from before", "cross-checking beads"
LEFT_OUT_CODES = ("no_positions", "constant_bead")
# Codes of notices that a reference bead moves by itself, seen on reading or on subtraction.
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
    asked = Asked(
        Path(path),
        Path(out),
        None if setup is None else Path(setup),
        seed,
        tuple(methods),
        cross_check,
        overwrite,
    )
    counted, shown = [0, 1], by_name(progress)

    def say(step: str, *done_of: int) -> None:
        counted[:] = done_of or counted
        shown(step, *counted)

    with enduring_executor(workers, hear=say) as pool:
        return finished(running(asked, pool, workers=workers, progress=say))


def running(
    asked: Asked,
    pool: Executor,
    *,
    workers: int = 1,
    only_forces: bool = False,
    raw: Recording | None = None,
    progress: NamedProgress,
) -> Steps[Run]:
    """`run` in steps: forces first, then the cross-check of each bead, all of it in the pool.

    What is done is kept in the folder until the run is complete: the same run goes on from there.

    Parameters
    ----------
    workers : processes that this recording's beads may take.
    only_forces : end once the forces are written, the cross-check to come.
    raw : the recording, where it is read already.

    Raises
    ------
    MtpipeError : what a user can mend, in one sentence.
    """
    out = asked.out
    if not asked.cross_check and not asked.overwrite:
        refuse_to_erase(out)
    make_ready(out)
    content = identity(asked)
    with journal(out, content) as done:
        kept, clock = Kept(pool, done), _Clock()
        raw, recording = _read(asked, raw, done, pool, workers, clock, progress)
        beads = len(recording.tethered)
        progress("calibrating beads", 0, beads)
        calibration = yield from calibrating(
            recording,
            kept,
            seed=asked.seed,
            progress=lambda done, total: progress("calibrating beads", done, total),
        )
        clock.lap("calibrate")
        turned = yield from turning(recording, calibration.forces, calibration.conditions, kept)
        others = by_methods(calibration, asked.methods)
        found = partial(_found, asked, content, recording, calibration, turned, others, clock)
        write = partial(_write, asked, raw, film=done / RECORDING, progress=progress)
        if not asked.cross_check:
            return write(found(None, complete=True))
        if _room_for_forces(out, content, overwrite=asked.overwrite):
            write(found(None, complete=False))
        if only_forces:
            return found(None, complete=False)
        progress(KEPT_BEADS, kept.there(beads), beads)
        examined = yield from examining(
            recording, kept, seed=asked.seed, parts=workers // max(beads, 1), progress=progress
        )
        clock.lap("crosscheck")
        return write(found(examined, complete=True))


def _room_for_forces(out: Path, content: str, *, overwrite: bool) -> bool:
    """Whether forces are written before they are cross-checked: they take no whole run's place."""
    earlier = told(out)
    if not earlier or earlier.get("content") == content:
        return not earlier
    return overwrite or not earlier.get("complete", True)


def _read(
    asked: Asked,
    raw: Recording | None,
    done: Path,
    pool: Executor,
    workers: int,
    clock: _Clock,
    say: NamedProgress,
) -> tuple[Recording, Recording]:
    """The recording as it came, and ready for calibration; a film is tracked first, once."""
    if asked.film:
        from mtpipe.tracking.track import track

        film = done / RECORDING
        if not film.exists():
            track(
                asked.path, film, setup=asked.setup_file, workers=workers, pool=pool, progress=say
            )
        clock.lap("track")
        raw = replace(load(film, asked.setup_file), name=asked.path.name)
    elif raw is None:
        say("reading", 0, 1)
        raw = load(asked.path, asked.setup)
    clock.lap("read")
    say("subtracting drift", 0, 1)
    raw = without_stretches(raw, asked.stretches)
    recording = subtract_drift(raw)
    clock.lap("drift")
    say("testing plateaus", 0, 1)
    recording = with_states(recording)
    clock.lap("states")
    return raw, recording


def _found(
    asked: Asked,
    content: str,
    recording: Recording,
    calibration: Calibration,
    turned: tuple[TurnedBead, ...],
    others: tuple[MethodResult, ...],
    clock: _Clock,
    examined: Examined | None,
    *,
    complete: bool,
) -> Run:
    """All that was found, with the forces to quote, the curves and the verdicts that follow."""
    found = {} if examined is None else examined.found
    forces = recommended_forces(calibration, found)
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
    return Run(
        recording,
        calibration,
        forces,
        others,
        flags,
        verdicts,
        curves,
        None if examined is None else examined.checked,
        content_of_mismatch(recording.name, found, forces, tolerance),
        {} if examined is None else examined.before_after,
        {} if examined is None else examined.unexplained,
        asked.stretches,
        asked.seed,
        clock.started,
        dict(clock.seconds),
        content,
        complete,
        turned,
    )


def _write(
    asked: Asked, raw: Recording, result: Run, *, film: Path, progress: NamedProgress
) -> Run:
    """Write a run into its folder; what was kept of it goes once nothing is left to do."""
    from mtpipe.report import write_report

    progress("writing", 0, 1)
    with new_run(asked.out) as fresh:
        if marks := read_marks(asked.out):
            write_marks(fresh, marks)
        if film.exists():
            shutil.copyfile(film, fresh / RECORDING)
        write_tables(result, raw, fresh, _title(asked.path, raw.name))
        write_report(
            fresh, progress=lambda done, total: progress("drawing the report", done, total)
        )
    if result.complete and not result.failed:
        clear_journals(asked.out)
    return result


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
    """When a run started, and seconds per step."""

    def __init__(self) -> None:
        self.started = datetime.now(UTC).isoformat(timespec="seconds")
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        now = time.perf_counter()
        self.seconds[step] = round(now - self._last, 3)
        self._last = now
