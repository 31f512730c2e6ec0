"""What a fast, long recording of one bead costs: calibrated and cross-checked.

    OMP_NUM_THREADS=1 python workflows/benchmark/fast_camera.py [--rate 10000] [--minutes 10] \
        [--plateaus 36] [--write docs/speed.md]

One process, after a small recording that has everything compiled. CPU seconds count; memory is the
process's resident set at its largest, beside one float array of all frames and three axes.
"""

from __future__ import annotations

import argparse
import platform
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import mtpipe
from mtpipe.setup.setup import Setup

sys.path.append(str(Path(__file__).parents[1] / "common"))
from pages import into_page, table
from short_tether import short_tether

# Share of a frame that is exposed, and the range of forces.
EXPOSED, FORCES_PN = 0.8, (0.1, 15.0)
MIB = 2.0**20


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rate", type=float, default=10_000.0, help="frames per second")
    parser.add_argument("--minutes", type=float, default=10.0, help="of all plateaus together")
    parser.add_argument("--plateaus", type=int, default=36)
    parser.add_argument("--write", type=Path, help="page to put the table into")
    options = parser.parse_args()
    frames = round(options.rate * options.minutes * 60 / options.plateaus)
    with tempfile.TemporaryDirectory() as scratch:
        stated = Path(scratch) / "setup.toml"
        stated.write_text(short_tether(options.rate, EXPOSED / options.rate), encoding="utf-8")
        setup = mtpipe.read_setup(stated)
    timed(setup, 2, round(6 * options.rate))
    row = timed(setup, options.plateaus, frames)
    array_MiB = 3 * 8 * options.plateaus * frames / MIB
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    head = " | ".join(["frames", *row, "MiB of an array", "MiB at most"])
    cells = [f"{options.plateaus * frames}", *row.values(), f"{array_MiB:.0f}", f"{largest:.0f}"]
    said = (
        f"Printed by `python workflows/benchmark/fast_camera.py --rate {options.rate:g} --minutes "
        f"{options.minutes:g} --plateaus {options.plateaus}`, Python {platform.python_version()} "
        f"on {platform.machine()}."
    )
    block = f"{said}\n\n{table(head, [cells])}"
    print(block)
    if options.write:
        page = options.write.read_text(encoding="utf-8")
        options.write.write_text(into_page(page, {"fast camera": block}), encoding="utf-8")


def timed(setup: Setup, plateaus: int, frames: int) -> dict[str, str]:
    """CPU seconds of each step of a recording of its own."""
    forces = np.geomspace(*FORCES_PN, plateaus)
    raw = mtpipe.simulate(setup, forces.tolist(), frames=frames, seed=1)
    began = time.process_time()
    recording = mtpipe.subtract_drift(raw)
    mtpipe.calibrate(recording)
    calibrated = time.process_time()
    found = mtpipe.crosscheck(recording, seed=1)
    checked = time.process_time()
    (bead,) = found.beads.values()
    return {
        "CPU s, calibrated": f"{calibrated - began:.0f}",
        "CPU s, cross-checked": f"{checked - calibrated:.0f}",
        "p": f"{bead.p_value:.2g}",
    }


if __name__ == "__main__":
    main()
