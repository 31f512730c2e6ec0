"""tweezepy on the study's traces, in an environment of its own that is made on first use.

Traces go over and answers come back as .npz files; `tweezepy_peer/fit.py` runs on the other side,
with the versions in `tweezepy_peer/requirements.txt`.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import traces
from traces import Case

sys.path.append(str(Path(__file__).parents[1] / "common"))
import peer_environment

PEER = Path(__file__).parent / "tweezepy_peer"
REQUIREMENTS = PEER / "requirements.txt"
# What a laboratory would state of its beads: 2 % from the friction of the simulated ones.
RADIUS_NM, VISCOSITY_PN_S_PER_NM2 = 1400.0, 8.9e-10


@dataclass(frozen=True)
class Job:
    """Traces of one case for tweezepy; `task` as in `tweezepy_peer/fit.py`."""

    python: Path
    case: Case
    seed: int
    repeats: int
    task: Literal["free", "noisy", "mcmc"]


def environment(folder: Path) -> Path:
    """Python interpreter of a virtual environment with tweezepy, made in a folder if need be."""
    return peer_environment.environment(folder, REQUIREMENTS)


def fit(job: Job) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names of what was fitted, the estimates, and their CPU time.

    Estimates are (repeats, methods, 2, 3): value, low and high of stiffness in pN/nm and friction
    in pN s/nm, nan where there are none; times (repeats, methods) in s.
    """
    drawn = [traces.draw(job.case, job.seed, repeat)[:2] for repeat in range(job.repeats)]
    with tempfile.TemporaryDirectory(prefix="mtpipe-study-") as name:
        asked, answered = Path(name) / "traces.npz", Path(name) / "answers.npz"
        np.savez(
            asked,
            task=job.task,
            seed=job.seed,
            x_nm=[x for x, _ in drawn],
            friction_pN_s_per_nm=[np.nan if known is None else known[0] for _, known in drawn],
            frame_rate_hz=traces.RATE_HZ,
            thermal_energy_pN_nm=traces.THERMAL_ENERGY,
            radius_nm=RADIUS_NM,
            viscosity_pN_s_per_nm2=VISCOSITY_PN_S_PER_NM2,
        )
        # it prints a line for every fit that fails, and a progress bar while it samples
        done = subprocess.run(
            [str(job.python), str(PEER / "fit.py"), str(asked), str(answered)],
            capture_output=True,
            text=True,
        )
        if done.returncode:
            raise RuntimeError(f"tweezepy_peer/fit.py failed:\n{done.stderr}")
        with np.load(answered) as answers:
            return list(map(str, answers["methods"])), answers["estimates"], answers["cpu_s"]
