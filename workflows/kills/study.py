"""Kill runs that write into an older run's folder, and look at what is there.

    python workflows/kills/study.py [--each N] [--random N]

A run is killed (SIGKILL) at every N-th thing that it does to a file in the folder (opening,
renaming, removing), and at random moments of its time. After each kill: files of two runs side by
side ("mixed"), a `run.json` beside files that the report refuses ("torn"), whose run it is once the
report has been asked for ("old", "new"), and whether a run that is not disturbed then ends with the
tables of one in an empty folder. Needs a system that forks.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd

import mtpipe
from mtpipe.ground.errors import MtpipeError
from mtpipe.report.folder import COLUMNS, JSON_FILES, read_run_folder
from mtpipe.report.run_folder import RUN, finish
from mtpipe.simulation.written import simulate_to_folder

EVENTS = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir")
SETUP = """\
schema = 1
[camera]
frame_rate_hz = 120.0
exposure_s = 0.0083
[beads]
radius_nm = 500.0
reference = ["ref1"]
[tether]
contour_length_nm = 1200.0
persistence_length_nm = 50.0
[buffer]
temperature_K = 298.15
viscosity_mPa_s = 0.89
[field]
direction = "x"
[model]
effects = ["wall_drag", "tracking_noise"]
"""


def analyse(recording: Path, out: Path) -> None:
    """A run, as short as one can be."""
    mtpipe.run(recording, out, cross_check=False, overwrite=True)


def killed(recording: Path, out: Path, moment: int | None, after_s: float) -> bool:
    """Whether a run was killed, at its k-th change of a file or after a time, before its end."""
    child = os.fork()
    if child == 0:
        done = 0

        def count(event: str, arguments: tuple[object, ...]) -> None:
            nonlocal done
            if event in EVENTS and str(arguments[0]).startswith(str(out)):
                done += 1
                if moment is not None and done > moment:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        analyse(recording, out)
        os._exit(0)
    if moment is None:
        time.sleep(after_s)
        os.kill(child, signal.SIGKILL)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def identities(folder: Path) -> set[str]:
    """The runs to which the files of a folder belong."""
    found = set()
    for name in (RUN, *JSON_FILES):
        if (folder / name).exists():
            found.add(json.loads((folder / name).read_bytes())["run"])
    for name in COLUMNS:
        if (folder / name).exists():
            found.add(pd.read_parquet(folder / name).attrs["run"])
    return found


def same_tables(one: Path, other: Path) -> bool:
    """Whether two runs found the same."""
    return all(pd.read_parquet(one / n).equals(pd.read_parquet(other / n)) for n in COLUMNS)


def look(out: Path, old: str, recording: Path, expected: Path) -> list[str]:
    """What is to be counted of a folder after a kill."""
    told = ["mixed"] if len(identities(out)) > 1 else []
    if (out / RUN).exists():
        try:
            read_run_folder(out)
        except MtpipeError:
            told.append("torn")
    finish(out)
    whose = json.loads((out / RUN).read_bytes())["run"]
    told.append("old" if whose == old else "new")
    analyse(recording, out)
    left = [path for path in out.iterdir() if path.name.startswith(".")]
    told.append("left over" if left else "cleared")
    told.append("rerun as expected" if same_tables(out, expected) else "rerun differs")
    return told


def main() -> None:
    """Print what was counted."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--each", type=int, default=1, help="kill at every N-th change")
    arguments.add_argument("--random", type=int, default=50, help="kills at random moments")
    asked = arguments.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "setup.toml").write_text(SETUP)
        for name, forces in (("a", [0.5]), ("b", [3.0])):
            simulate_to_folder(folder / "setup.toml", folder / name, forces, 1024, 1)
        recording = folder / "b" / "recording.csv"
        analyse(folder / "a" / "recording.csv", folder / "old")
        started = time.monotonic()
        analyse(recording, folder / "expected")
        lasted = time.monotonic() - started
        (old,) = identities(folder / "old")
        counts: dict[str, Counter[str]] = {}
        random = np.random.default_rng(0)
        moments = [("each change", k * asked.each, 0.0) for k in range(10_000)]
        moments += [("at random", None, s) for s in random.uniform(0, lasted, asked.random)]
        ended = False
        for kind, moment, after_s in moments:
            if kind == "each change" and ended:
                continue
            out = folder / "out"
            shutil.rmtree(out, ignore_errors=True)
            shutil.copytree(folder / "old", out)
            if not killed(recording, out, moment, after_s):
                ended = kind == "each change"
                continue
            told = look(out, old, recording, folder / "expected")
            counts.setdefault(kind, Counter()).update(["kills", *told])
            print(
                f"{kind} {moment if moment is not None else after_s}: {', '.join(told)}", flush=True
            )
        for kind, counted in counts.items():
            print(f"{kind}: {', '.join(f'{n} {what}' for what, n in counted.items())}")


if __name__ == "__main__":
    main()
