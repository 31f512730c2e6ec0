"""How long a batch takes: by the number of its beads, and by who does the work.

    python workflows/benchmark/scaling.py [--beads 10 100 1000] [--write docs/speed.md]

A day is simulated in recordings of ten beads, two plateaus of 1024 frames each, and given to
`mtpipe batch`, cross-check and diagnosis included. The smallest day is done once beforehand, so
that all is compiled. The middle one is done by one process, by two, and by a Dask cluster of two
workers on this machine; the others by two processes. Memory is the resident set at its largest,
looked at four times a second. Needs the extra `mtpipe[cluster]`.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import psutil
from distributed import LocalCluster

from mtpipe.simulation.written import simulate_to_folder

sys.path.append(str(Path(__file__).parents[1] / "common"))
from pages import into_page, table
from short_tether import short_tether

BEADS_PER_RECORDING, FRAMES, FORCES_PN = 10, 1024, (1.0, 5.0)
SETUP = short_tether(200.0, 0.005)
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
LOOKED_EVERY_S, MIB = 0.25, 2.0**20


@dataclass(frozen=True)
class Took:
    """What a batch took: seconds, and MiB of its own process and of its largest worker."""

    seconds: float
    own_MiB: float
    worker_MiB: float


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--beads", type=int, nargs=3, default=(10, 100, 1000), help="of three days")
    parser.add_argument("--write", type=Path, help="page to put the table into")
    options = parser.parse_args()
    small, middle, large = options.beads
    two = ["--workers", "2"]
    os.environ |= ONE_THREAD
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        days = {beads: day(folder / f"day{beads}", beads) for beads in options.beads}
        batch(days[small], folder / "compiled", ["--workers", "1"])
        rows = [
            ("two processes", small, batch(days[small], folder / "small", two)),
            ("one process", middle, batch(days[middle], folder / "one", ["--workers", "1"])),
            ("two processes", middle, batch(days[middle], folder / "two", two)),
        ]
        with LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
        ) as started:
            there = [*two, "--scheduler", started.scheduler_address]
            rows.append(("a Dask cluster of two", middle, batch(days[middle], folder / "d", there)))
        rows.append(("two processes", large, batch(days[large], folder / "large", two)))
    header = "beads | done by | minutes | beads a minute | MiB of the command | MiB of a worker"
    cells = [
        [
            f"{beads}",
            who,
            f"{took.seconds / 60:.1f}",
            f"{60 * beads / took.seconds:.0f}",
            f"{took.own_MiB:.0f}",
            f"{took.worker_MiB:.0f}",
        ]
        for who, beads, took in rows
    ]
    text = (
        f"Printed by `python workflows/benchmark/scaling.py --beads {small} {middle} {large}`, "
        f"Python {platform.python_version()} on {platform.machine()}, {os.cpu_count()} cores.\n\n"
        f"{table(header, cells)}"
    )
    print(text)
    if options.write is not None:
        page = into_page(options.write.read_text(encoding="utf-8"), {"scaling": text})
        options.write.write_text(page, encoding="utf-8")


def day(folder: Path, beads: int) -> Path:
    """A folder of recordings with so many beads in all."""
    folder.mkdir()
    setup = folder / "setup.toml"
    setup.write_text(SETUP, encoding="utf-8")
    for first in range(0, beads, BEADS_PER_RECORDING):
        few = min(BEADS_PER_RECORDING, beads - first)
        made = folder.parent / f"{folder.name}-{first}"
        simulate_to_folder(setup, made, FORCES_PN, FRAMES, first, beads=few)
        (made / "recording.csv").rename(folder / f"r{first}.csv")
    return folder


def batch(recordings: Path, out: Path, options: list[str]) -> Took:
    """Do a day."""
    command = [sys.executable, "-m", "mtpipe", "batch", str(recordings), "--out", str(out)]
    began = time.monotonic()
    working = subprocess.Popen(
        [*command, *options], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    own = worker = 0
    while working.poll() is None:
        for process in psutil.Process().children(recursive=True):
            try:
                size = process.memory_info().rss
            except psutil.NoSuchProcess:
                continue
            if process.pid == working.pid:
                own = max(own, size)
            else:
                worker = max(worker, size)
        time.sleep(LOOKED_EVERY_S)
    if working.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {working.returncode}")
    return Took(time.monotonic() - began, own / MIB, worker / MIB)


if __name__ == "__main__":
    main()
