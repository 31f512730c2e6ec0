"""Measures works with the mtpipe it finds: a line of JSON in, a line of JSON out (`speed.py`).

It asks for no more than mtpipe's public names, which an older commit has too.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import mtpipe

SETUP = Path("sample_data") / "clean_short_tether" / "setup.toml"
FORCES_PN = (0.2, 12.0)
CONSISTENT_FORCES_PN = (0.5, 2.0, 8.0)
MIB = 2.0**20
SMALL = {"beads": 1, "frames": 1024, "plateaus": 2}


def main() -> None:
    """Answer until there is no more to do."""
    setup = mtpipe.read_setup(SETUP)
    warm: set[str] = set()
    for line in sys.stdin:
        work = json.loads(line)
        if work["what"] not in warm:
            # compiles, and imports what is imported late
            measured(work | SMALL, setup)
            warm.add(work["what"])
        print(json.dumps(measured(work, setup)), flush=True)


def measured(work: dict[str, Any], setup: mtpipe.Setup) -> dict[str, Any]:
    """CPU seconds of one work, and the memory it took beyond the recording's arrays."""
    if "path" in work:
        raw = mtpipe.load(work["path"])
    elif work["what"] == "field":
        forces = np.geomspace(*FORCES_PN, work["plateaus"])
        raw = mtpipe.simulate(setup, forces, frames=work["frames"], beads=work["beads"], seed=1)
    else:
        raw = mtpipe.simulate(setup, CONSISTENT_FORCES_PN, frames=work["frames"], seed=1)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MIB
    began = time.process_time()
    recording = mtpipe.subtract_drift(raw)
    if work["what"] == "series":
        began = time.process_time()
    if work["what"] == "crosscheck":
        mtpipe.crosscheck(recording)
    if work["what"] == "diagnosis":
        mtpipe.diagnose(recording)
    mtpipe.calibrate(recording)
    cpu_s = time.process_time() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MIB
    arrays = sum(one.nbytes for one in recording.positions_nm.values()) / MIB
    return {"cpu_s": cpu_s, "beyond_arrays_MiB": max(peak - before - arrays, 0.0)}


if __name__ == "__main__":
    main()
