"""Kill runs that write into an older run's folder, fill their disc, and look at what is there.

    python workflows/kills/study.py [--parts writes within report random full short disc worker]

Each trial: a folder holds a sound run of one recording, and a run of another recording into it is
disturbed. Then the folder is looked at, `mtpipe report` is asked for, and an undisturbed run is
made in it. Parts:

writes, within : killed before each change of a file or folder; killed as each file is written
report : `mtpipe report` killed before each change
random : `python -m mtpipe run` with two workers killed (SIGKILL) at random moments
full, short : no room from the k-th new file or folder on; files cannot grow from the k-th on
disc : a file system in memory (tmpfs) that is full after some bytes; needs root
worker : one of two workers killed

Prints a row per part; every column after `between` has to be 0, else the exit code is 1.
`disturbed` counts commands that did not come to their end; `between` counts folders whose new run
was all there and still taking its place as it was killed: they are without `run.json`, and whole as
soon as anything of mtpipe looks at them. Needs Linux.
docs/kills.md has the figures.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from disturbed import Ended, Fault, Kind, changes, command, prepare
from folders import Contents, contents, found, leftovers
from sessions import kill_worker, left, started, workers

from mtpipe.simulation.written import simulate_to_folder

sys.path.append(str(Path(__file__).parents[1] / "common"))
from short_tether import short_tether

PARTS = ("writes", "within", "report", "random", "full", "short", "disc", "worker")
FULL = ("No space left on device", "File too large")
WORKER_TOLD = "a worker process was ended from outside"
SETUP = short_tether(120.0, 0.0083, viscosity_mPa_s=0.89)
FRAMES = 1024
TOLD = ("trials", "disturbed", "between")  # columns that may be more than 0
PAGE = resource.getpagesize()


@dataclass(frozen=True)
class Stage:
    """Two runs that nobody disturbed: one is there already, another is to take its place.

    Attributes
    ----------
    out : the folder in which they follow each other, alone in its parent.
    kept : where the old run is kept.
    recording : of the new run. runs : what both hold.
    """

    out: Path
    kept: Path
    recording: Path
    runs: dict[str, Contents]

    def set(self) -> None:
        """Put the old run where the new one is to come, and nothing else."""
        shutil.rmtree(self.out.parent, ignore_errors=True)
        shutil.copytree(self.kept, self.out)

    def run(self, workers: int = 1) -> list[str]:
        """Arguments of the new run, as short as one can be."""
        short = ("--no-crosscheck", "--workers", str(workers))
        return ["run", str(self.recording), "--out", str(self.out), *short]


@dataclass
class Counts:
    """What went wrong, in so many trials."""

    trials: int = 0
    disturbed: int = 0
    between: int = 0
    torn: int = 0
    mixed: int = 0
    lost: int = 0  # the old run, where the new one ended with an error
    untold: int = 0  # no single sentence that names what happened
    tracebacks: int = 0
    report_fails: int = 0
    rerun_differs: int = 0
    leftovers: int = 0
    processes: int = 0

    def wrong(self) -> dict[str, int]:
        """All that has to be 0."""
        counted = {one.name: getattr(self, one.name) for one in fields(self)}
        return {k: n for k, n in counted.items() if n and k not in TOLD}


def main() -> None:
    """Disturb runs, print what was counted; fail where anything went wrong."""
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    options.add_argument("--each", type=int, default=1, help="only each N-th change (default: all)")
    options.add_argument("--first", type=int, default=0, help="the first of them, from 0")
    options.add_argument("--random", type=int, default=50, help="kills at random moments")
    options.add_argument("--discs", type=int, default=12, help="sizes of a full disc")
    options.add_argument("--workers-killed", type=int, default=10)
    asked = options.parse_args()
    heading = [one.name.replace("_", " ") for one in fields(Counts)]
    rows, wrong = [["part", *heading]], False
    with tempfile.TemporaryDirectory(prefix="mtpipe-kills-") as scratch:
        small = prepared(Path(scratch) / "small", beads=1)
        several = small
        if {"random", "worker"} & {*asked.parts}:
            several = prepared(Path(scratch) / "several", beads=2)
        for part in asked.parts:
            counts = Counts()
            for label, disturb in trials(part, small, several, asked):
                before = counts.wrong()
                tried(several if part in ("random", "worker") else small, counts, disturb, part)
                now = counts.wrong()
                told = "as it should be" if now == before else f"wrong until now: {now}"
                print(f"{part} {label}: {told}", flush=True)
            rows.append([part, *(str(getattr(counts, one.name)) for one in fields(Counts))])
            print(" ".join(rows[-1]), flush=True)
            wrong |= bool(counts.wrong())
    print("\n".join(["", *table(rows)]))
    sys.exit(int(wrong))


def prepared(folder: Path, beads: int) -> Stage:
    """The recordings and the runs of trials."""
    folder.mkdir()
    (folder / "setup.toml").write_text(SETUP)
    for name, force_pN in (("old", 0.5), ("new", 3.0)):
        simulate_to_folder(folder / "setup.toml", folder / name, [force_pN], FRAMES, 1, beads=beads)
    runs = {}
    for name in ("old", "new"):
        out = folder / f"{name}-run"
        prepare(folder / name, out)
        runs[name] = contents(out)
    return Stage(folder / "trial" / "out", folder / "old-run", folder / "new", runs)


Disturb = Callable[[Counts], Ended]


def trials(
    part: str, small: Stage, several: Stage, asked: argparse.Namespace
) -> Iterator[tuple[str, Disturb]]:
    """The trials of a part: what each is called, and what it does to a stage that is set."""
    if part == "random":
        yield from killed_at_random(several, asked.random)
    elif part == "worker":
        yield from with_a_worker_killed(several, asked.workers_killed)
    elif part == "disc":
        yield from on_a_small_disc(small, asked.discs)
    else:
        kinds: dict[str, Kind] = {"writes": "kill", "report": "kill"}
        kind = kinds.get(part, part)  # type: ignore[arg-type]
        arguments = ["report", str(small.out)] if part == "report" else small.run()
        small.set()
        for at in range(asked.first, changes(arguments, small.out.parent, kind), asked.each):
            fault = Fault(kind, at)
            yield str(at), lambda _, f=fault: command(arguments, small.out.parent, f)


def tried(stage: Stage, counts: Counts, disturb: Disturb, part: str) -> None:
    """Disturb a command, look at its folder, ask for a report and make the run again."""
    stage.set()
    ended = disturb(counts)
    counts.trials += 1
    counts.disturbed += ended.code != 0
    if part != "report":
        look(stage, counts)
    failed = ended.code > 0
    if failed:
        expected = (WORKER_TOLD,) if part == "worker" else FULL
        counts.untold += not is_a_sentence(ended) or not any(e in ended.said for e in expected)
        counts.lost += found(stage.out, stage.runs).whole != "old"
    counts.untold += ended.code == 0 and found(stage.out, stage.runs).whole != "new"
    reported = command(["report", str(stage.out)], stage.out.parent)
    counts.report_fails += reported.code != 0
    counts.report_fails += not found(stage.out, stage.runs).whole
    again = command(stage.run(), stage.out.parent)
    counts.rerun_differs += again.code != 0 or found(stage.out, stage.runs).whole != "new"
    counts.leftovers += bool(leftovers(stage.out))
    counts.tracebacks += any("Traceback" in one.said for one in (ended, reported, again))


def look(stage: Stage, counts: Counts) -> None:
    """Count what a folder is after a disturbance."""
    seen = found(stage.out, stage.runs)
    counts.torn += seen.torn
    counts.mixed += seen.mixed
    counts.between += not (seen.whole or seen.torn or seen.mixed)


def is_a_sentence(ended: Ended) -> bool:
    """Whether a command said one line, and that it is no defect of mtpipe's."""
    lines = ended.said.strip().splitlines()
    return len(lines) == 1 and lines[0].startswith("mtpipe: ") and "defect" not in lines[0]


def killed_at_random(stage: Stage, count: int) -> Iterator[tuple[str, Disturb]]:
    """Runs that are killed from outside at a moment of their time."""
    stage.set()
    began = time.monotonic()
    started(stage.run(workers=2)).communicate()
    lasts_s = time.monotonic() - began
    for moment_s in np.random.default_rng(0).uniform(0, lasts_s, count):

        def disturb(counts: Counts, after_s: float = float(moment_s)) -> Ended:
            with started(stage.run(workers=2)) as process:
                try:
                    _, said = process.communicate(timeout=after_s)
                except subprocess.TimeoutExpired:
                    process.kill()
                    # workers hold standard error open until they end
                    counts.processes += left(process.pid)
                    _, said = process.communicate()
            return Ended(process.returncode, said.decode())

        yield f"after {moment_s:.2f} of {lasts_s:.2f} s", disturb


def with_a_worker_killed(stage: Stage, count: int) -> Iterator[tuple[str, Disturb]]:
    """Runs one of whose workers is killed, some time after it has begun."""
    random = np.random.default_rng(0)
    stage.set()
    lived_s = _time_of_workers(stage)
    for moment_s in random.uniform(0, lived_s, count):

        def disturb(counts: Counts, after_s: float = float(moment_s)) -> Ended:
            with started(stage.run(workers=2)) as process:
                _wait_for_worker(process)
                time.sleep(after_s)
                kill_worker(process.pid)
                _, said = process.communicate()
            counts.processes += left(process.pid)
            return Ended(process.returncode, said.decode())

        yield f"after {moment_s:.2f} of {lived_s:.2f} s", disturb


def _time_of_workers(stage: Stage) -> float:
    """How long a run has workers, in s."""
    with started(stage.run(workers=2)) as process:
        _wait_for_worker(process)
        began = time.monotonic()
        while workers(process.pid):
            time.sleep(0.05)
        lived_s = time.monotonic() - began
        process.communicate()
    return lived_s


def _wait_for_worker(process: subprocess.Popen[bytes]) -> None:
    while process.poll() is None and not workers(process.pid):
        time.sleep(0.05)


def on_a_small_disc(stage: Stage, count: int) -> Iterator[tuple[str, Disturb]]:
    """Runs on a disc that has room for the old run and for a part of the new one."""
    run = sum(_on_disc(path) for path in stage.kept.rglob("*"))
    for size in np.linspace(1.01 * run, 2.0 * run, count).astype(int).tolist():

        def disturb(_: Counts, size: int = size) -> Ended:
            parent = stage.out.parent
            shutil.rmtree(parent)
            parent.mkdir()
            mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(parent)]
            subprocess.run(mount, check=True)
            try:
                shutil.copytree(stage.kept, stage.out)
                ended = command(stage.run(), parent)
                aside = stage.kept.with_name("aside")
                shutil.rmtree(aside, ignore_errors=True)
                shutil.copytree(stage.out, aside)
            finally:
                subprocess.run(["umount", str(parent)], check=True)
            shutil.copytree(aside, stage.out)
            return ended

        yield f"{size} bytes", disturb


def _on_disc(path: Path) -> int:
    """How many bytes a file takes, in pages."""
    return -(-path.stat().st_size // PAGE) * PAGE


def table(rows: list[list[str]]) -> list[str]:
    """Rows as a table of Markdown."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return [lines[0], f"|{' --- |' * len(rows[0])}", *lines[1:]]


if __name__ == "__main__":
    main()
