"""mtpipe on the real recordings, beside what their owners say.

    python workflows/real_recordings/compare.py --recordings ../shared/recordings

Prints the tables of docs/real-recordings.md. Nothing is written but temporary files: the recordings
are not ours, and neither they nor anything made of them but numbers belongs into the repository.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from pathlib import Path

import cmaddry
import crosscheck_map
import diagnosed
import others
from staircase import ROWS, SETUPS, series_of

from mtpipe.calibration.calibration import calibrate
from mtpipe.drift import subtract_drift
from mtpipe.ingest import load
from mtpipe.pipeline import run as pipeline
from mtpipe.states import with_states

CHECKOUT = Path(__file__).resolve().parents[2]


def main() -> None:
    """Run everything and print it."""
    parser = argparse.ArgumentParser(description="mtpipe on the real recordings.")
    parser.add_argument(
        "--recordings", type=Path, default=CHECKOUT.parent / "shared" / "recordings"
    )
    parser.add_argument(
        "--only", choices=("cmaddry", "map", "diagnosis", "others"), help="one part alone"
    )
    parser.add_argument("--of", choices=tuple(ROWS), help="diagnosis of one recording alone")
    parser.add_argument("--beads", nargs="+", default=[], help="diagnosis of these beads alone")
    choice = parser.parse_args()
    if choice.only in (None, "cmaddry"):
        _complete_case(choice.recordings / "cmaddry-run2")
    if choice.only in (None, "map"):
        _map(choice.recordings / "cmaddry-run2")
    if choice.only in (None, "diagnosis"):
        for name in [choice.of] if choice.of else ROWS:
            _diagnosis(name, choice.recordings, choice.beads)
    if choice.only in (None, "others"):
        _say("Other recordings", others.answers(choice.recordings, SETUPS))


def _complete_case(folder: Path) -> None:
    began, spent = time.perf_counter(), _cpu_s()
    workers = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as out:
        run = pipeline.run(folder, Path(out), setup=SETUPS / "cmaddry-run2.toml", workers=workers)
    wall, cpu = time.perf_counter() - began, _cpu_s() - spent
    conditions = run.calibration.conditions
    recording = cmaddry.with_exposure(run.recording, conditions.exposure_s)
    full_frame = cmaddry.with_exposure(run.recording, 1 / conditions.frame_rate_hz)
    radius = conditions.radius_nm
    assert radius is not None
    print(f"cmaddry-run2: mtpipe run took {wall:.0f} s, {cpu:.0f} s of CPU, {workers} workers")
    owners_ranges = cmaddry.on_owners_ranges(recording)
    _say("Forces beside the owners'", cmaddry.table_of_forces(recording, owners_ranges))
    for title, calibration, plateaus in (
        ("the owners' ranges", owners_ranges, range(2)),
        ("the recording", run.calibration, cmaddry.STRONG),
    ):
        _say(f"Joint fits of {title}", cmaddry.joint_fits(calibration))
        _say(f"Forces of joint fits of {title}", cmaddry.joint_forces(calibration, plateaus))
    _say("Forces of y over x", cmaddry.force_ratios(run.calibration))
    _say("Friction as mtpipe runs", cmaddry.friction_table(run.calibration))
    _say("Friction for a full frame", cmaddry.friction_table(calibrate(full_frame, workers=2)))
    _say("Axis of the field", cmaddry.field_axis(run.calibration))
    _say("Attachment", cmaddry.attachment(run.recording, radius[0]))
    _say("Tethers", cmaddry.tethers(run))
    _say("Force and extension", cmaddry.curve_table(run))
    _say("Quality checks", cmaddry.quality(run))


def _map(folder: Path) -> None:
    began, workers = _cpu_s(), os.cpu_count() or 1
    raw = load(folder, SETUPS / "cmaddry-run2.toml")
    subtracted = subtract_drift(raw)
    _say("Map of the long dwells", crosscheck_map.dwells(raw, subtracted, workers))
    _say("Map of the turns, untold", crosscheck_map.turns(subtracted, workers))
    _say("Map of a series", crosscheck_map.series(with_states(subtracted), workers))
    print(f"\nThe maps took {_cpu_s() - began:.0f} s of CPU")


def _diagnosis(name: str, recordings: Path, beads: list[str]) -> None:
    began = _cpu_s()
    _say(f"Diagnosis of a series of {name}", diagnosed.series(series_of(name, recordings), beads))
    print(f"\nThe diagnosis took {_cpu_s() - began:.0f} s of CPU")


def _cpu_s() -> float:
    """CPU time of this process and of its workers that have ended; other jobs do not count."""
    of_all = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in of_all)


def _say(title: str, lines: list[str]) -> None:
    print(f"\n{title}\n{'-' * len(title)}")
    print("\n".join(lines), flush=True)


if __name__ == "__main__":
    main()
