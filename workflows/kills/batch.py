"""Kill batches at random moments, give the same command again, and compare with one left alone.

    python workflows/kills/batch.py [--parts main worker disc] [--main 40] [--worker 10] [--discs 4]

main : SIGKILL of `python -m mtpipe batch --workers 2` at a moment drawn evenly over its work
worker : SIGKILL of one of its two workers, at such a moment
disc : a file system in memory (tmpfs) that is full after some bytes, then room; needs root

After each disturbance the folders of runs are looked at; then the same command is given until it
comes to its end (`main` disturbs it a second time first). Moments are of processor time, so that
they are the same of the work however busy the machine is. Prints a row per part; every column after
`between` has to be 0, else the exit code is 1. Needs Linux. docs/kills.md has the figures.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from folders import Contents, contents, found
from sessions import kill_worker, left, started, wait_until_spent, workers
from study import FRAMES, FULL, SETUP, WORKER_TOLD, table

from mtpipe.ground.processes import executor
from mtpipe.ground.steps import finished
from mtpipe.pipeline.identity import Asked
from mtpipe.pipeline.run import running
from mtpipe.simulation.written import simulate_to_folder

RECORDINGS = {"morning/r1.csv": 2, "noon.csv": 1}  # and how many beads they have
SUMMARY, PAGE = "summary.csv", "index.html"
TOLD = ("trials", "disturbed", "between")  # columns that may be more than 0


@dataclass(frozen=True)
class Day:
    """A folder of recordings, what a batch of it makes, and where batches are disturbed.

    Attributes
    ----------
    runs : of each recording, the run with forces alone and the whole one. summary : the two files.
    spends_s : processor time of a batch.
    """

    folder: Path
    out: Path
    runs: Mapping[str, Mapping[str, Contents]]
    summary: Mapping[str, bytes]
    spends_s: float

    def arguments(self) -> list[str]:
        """Of the command."""
        return ["batch", str(self.folder), "--out", str(self.out), "--workers", "2"]


@dataclass
class Counts:
    """What went wrong, in so many trials."""

    trials: int = 0
    disturbed: int = 0
    between: int = 0
    torn: int = 0
    mixed: int = 0
    untold: int = 0  # no sentence that names what happened
    tracebacks: int = 0
    summary_torn: int = 0
    end_differs: int = 0
    leftovers: int = 0
    processes: int = 0


Disturb = Callable[[Counts], None]


def main() -> None:
    """Disturb batches, print what was counted; fail where anything went wrong."""
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    options.add_argument("--main", type=int, default=40, help="kills of the main process")
    options.add_argument("--worker", type=int, default=10, help="kills of a worker")
    options.add_argument("--discs", type=int, default=4, help="sizes of a full disc")
    asked = options.parse_args()
    rows, wrong = [["part", *(one.name.replace("_", " ") for one in fields(Counts))]], False
    with tempfile.TemporaryDirectory(prefix="mtpipe-kills-") as scratch:
        day = prepared(Path(scratch))
        for part in asked.parts:
            counts = Counts()
            for label, disturb in PARTS[part](day, asked):
                tried(day, counts, disturb)
                print(f"{part} {label}: {counts}", flush=True)
            rows.append([part, *(str(getattr(counts, one.name)) for one in fields(counts))])
            wrong |= any(
                getattr(counts, one.name) for one in fields(counts) if one.name not in TOLD
            )
    print("\n".join(["", *table(rows)]))
    sys.exit(int(wrong))


def prepared(scratch: Path) -> Day:
    """The recordings, and what a batch makes of them that nobody disturbs."""
    folder, undisturbed = scratch / "day", scratch / "undisturbed"
    folder.mkdir()
    setup = folder / "setup.toml"
    setup.write_text(SETUP)
    runs: dict[str, dict[str, Contents]] = {}
    for seed, (name, beads) in enumerate(RECORDINGS.items()):
        simulate_to_folder(setup, scratch / "one", [2.0], FRAMES, seed, beads=beads)
        (folder / name).parent.mkdir(exist_ok=True)
        (scratch / "one" / "recording.csv").rename(folder / name)
        first = scratch / "forces" / name
        asked = Asked(folder / name, first, setup, overwrite=True)
        with executor(1) as pool:
            finished(running(asked, pool, only_forces=True, progress=lambda *_: None))
        runs[name] = {"forces": contents(first)}
    before_s = _children_s()
    day = Day(folder, undisturbed, runs, {}, 0.0)
    _, said = started(day.arguments()).communicate()
    spends_s = _children_s() - before_s
    for name in RECORDINGS:
        if not (undisturbed / name).exists():
            raise RuntimeError(said.decode())
        runs[name]["whole"] = contents(undisturbed / name)
    summary = {name: (undisturbed / name).read_bytes() for name in (SUMMARY, PAGE)}
    return Day(folder, scratch / "trial" / "out", runs, summary, spends_s)


def _children_s() -> float:
    """Processor time of all commands that have ended, their workers included."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def tried(day: Day, counts: Counts, disturb: Disturb) -> None:
    """Disturb a batch, and give the command again until it ends."""
    shutil.rmtree(day.out.parent, ignore_errors=True)
    day.out.parent.mkdir()
    counts.trials += 1
    disturb(counts)
    process = started(day.arguments())
    _, said = process.communicate()
    counts.tracebacks += b"Traceback" in said
    counts.processes += left(process.pid)
    whole = [found(day.out / name, runs).whole for name, runs in day.runs.items()]
    same = all((day.out / name).read_bytes() == text for name, text in day.summary.items())
    counts.end_differs += process.returncode != 0 or set(whole) != {"whole"} or not same
    counts.leftovers += any(path.name.startswith(".") for path in day.out.rglob("*"))


def look(day: Day, counts: Counts) -> None:
    """Count what the folders are after a disturbance."""
    for name, runs in day.runs.items():
        if any(path.suffix for path in (day.out / name).glob("[!.]*")):
            seen = found(day.out / name, runs)
            counts.torn += seen.torn
            counts.mixed += seen.mixed
            counts.between += not (seen.whole or seen.torn or seen.mixed)
    table = day.out / SUMMARY
    counts.summary_torn += table.exists() and not table.read_bytes().endswith(b"\n")


def ended(counts: Counts, process: subprocess.Popen[bytes], expected: tuple[str, ...]) -> None:
    """Count how a disturbed command ended."""
    _, said = process.communicate()
    counts.processes += left(process.pid)
    counts.disturbed += process.returncode != 0
    counts.tracebacks += b"Traceback" in said
    if process.returncode > 0:
        last = said.decode().strip().splitlines()[-1]
        sentence = last.startswith("mtpipe: ") and "defect" not in last
        counts.untold += not sentence or not any(one in last for one in expected)


def killed(day: Day, asked: argparse.Namespace) -> Iterator[tuple[str, Disturb]]:
    """The main process is killed, and once more as it goes on."""
    moments = np.random.default_rng(0).uniform(0, day.spends_s, (asked.main, 2))
    for first_s, second_s in moments.tolist():

        def disturb(counts: Counts, after_s: tuple[float, float] = (first_s, second_s)) -> None:
            for moment_s in after_s:
                process = started(day.arguments())
                wait_until_spent(process, moment_s)
                process.kill()
                ended(counts, process, ())
                look(day, counts)

        yield f"after {first_s:.1f} and {second_s:.1f} of {day.spends_s:.1f} s", disturb


def with_a_worker_killed(day: Day, asked: argparse.Namespace) -> Iterator[tuple[str, Disturb]]:
    """One of the workers is killed."""
    for moment_s in np.random.default_rng(0).uniform(0, day.spends_s, asked.worker).tolist():

        def disturb(counts: Counts, after_s: float = moment_s) -> None:
            process = started(day.arguments())
            while process.poll() is None and not workers(process.pid):
                time.sleep(0.05)
            wait_until_spent(process, after_s)
            kill_worker(process.pid)
            ended(counts, process, (WORKER_TOLD,))
            look(day, counts)

        yield f"after {moment_s:.1f} s", disturb


def on_a_small_disc(day: Day, asked: argparse.Namespace) -> Iterator[tuple[str, Disturb]]:
    """There is no room for all of it, and then there is."""
    size = sum(
        path.stat().st_size for path in day.out.parents[1].joinpath("undisturbed").rglob("*")
    )
    for bytes_ in np.linspace(0.05 * size, 0.9 * size, asked.discs).astype(int).tolist():

        def disturb(counts: Counts, room: int = bytes_) -> None:
            parent, aside = day.out.parent, day.out.parent.with_name("aside")
            shutil.rmtree(aside, ignore_errors=True)
            mount = ["mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", str(parent)]
            subprocess.run(mount, check=True)
            try:
                ended(counts, started(day.arguments()), FULL)
                look(day, counts)
                shutil.copytree(parent, aside)
            finally:
                subprocess.run(["umount", str(parent)], check=True)
            shutil.copytree(aside, parent, dirs_exist_ok=True)

        yield f"{bytes_} bytes", disturb


PARTS = {"main": killed, "worker": with_a_worker_killed, "disc": on_a_small_disc}

if __name__ == "__main__":
    main()
