"""How soon after the end of a plateau `mtpipe watch` has its forces.

    python workflows/benchmark/watch.py [--beads 4] [--plateaus 5] [--frames 8192] [--workers 2]

A simulated recording of 400 frames a second is written at the speed of its camera, a second at a
time. Prints, for each plateau, the seconds from its end to `forces.csv` with its forces.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from mtpipe.simulation.written import simulate_to_folder

sys.path.append(str(Path(__file__).parents[1] / "common"))
from short_tether import short_tether

RATE_HZ = 400
SETUP = short_tether(float(RATE_HZ), 0.0025)


def main() -> None:
    """Write a recording beside a watching mtpipe, and print how long each plateau took."""
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    for name, default in (("beads", 4), ("plateaus", 5), ("frames", 8192), ("workers", 2)):
        options.add_argument(f"--{name}", type=int, default=default)
    asked = options.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        day, out = folder / "day", folder / "out"
        day.mkdir()
        (day / "setup.toml").write_text(SETUP)
        forces = np.geomspace(0.5, 6.0, asked.plateaus).tolist()
        setup = day / "setup.toml"
        simulate_to_folder(setup, folder / "s", forces, asked.frames, 0, beads=asked.beads)
        lines = (folder / "s" / "recording.csv").read_text().splitlines(keepends=True)
        command = [sys.executable, "-m", "mtpipe", "watch", str(day), "--out", str(out)]
        watching = subprocess.Popen([*command, "--workers", str(asked.workers)])
        try:
            _follow(lines, day / "r.csv", out / "r.csv" / "forces.csv", asked)
        finally:
            watching.terminate()
            watching.wait()


def _follow(lines: list[str], path: Path, table: Path, asked: argparse.Namespace) -> None:
    data = next(n for n, line in enumerate(lines) if line.startswith("time_s")) + 1
    began, written, known = time.monotonic(), 0, 0
    while known < asked.plateaus:
        due = data + int((time.monotonic() - began) * RATE_HZ)
        with path.open("a") as stream:
            stream.writelines(lines[written:due])
        written = max(written, min(due, len(lines)))
        there = set(pd.read_csv(table)["plateau"]) if table.exists() else set()
        for plateau in sorted(there)[known:]:
            ended_s = (plateau + 1) * asked.frames / RATE_HZ
            print(f"plateau {plateau}: {time.monotonic() - began - ended_s:.1f} s", flush=True)
        known = len(there)
        time.sleep(1.0)


if __name__ == "__main__":
    main()
