"""Frames per second of every simulator, at one setting: the benchmark of docs/simulation.md.

    python workflows/benchmark/simulators.py --write docs/simulation.md

CPU seconds of one process on one core, the best of several runs. The exact simulator of springs has
no time step, and its variances no bias. One that steps makes them too large by half its step over
the relaxation time (Euler's method); "equal accuracy" is a step for which that is below a
stated share in every coordinate that is simulated. tweezepy's step is a 1000th of a frame, whatever
the spring.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

# one core for every simulator; the libraries read this when they are loaded
os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")

import numpy as np

import mtpipe
from mtpipe.experiment.description import Bead, Experiment, Fluid, Rest, Stage, Tracker
from mtpipe.experiment.recorded_modes import BeadState
from mtpipe.experiment.state import bead_state
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_axis
from mtpipe.physics.tether import Chain
from mtpipe.simulation.bead import BrownianBead
from mtpipe.simulation.brownian import longest_time_step_s, simulate_bead
from mtpipe.simulation.linear import simulate_motion
from mtpipe.simulation.springs import simulate_springs
from mtpipe.simulation.steps import divide_frame

HERE = Path(__file__).resolve().parent
RATE_HZ = 120.0
CAMERA = Camera(1 / RATE_HZ, 1 / RATE_HZ)
# Shares by which a time step may make a variance too large.
ACCURACIES = (0.01, 0.001)
EXACT_FRAMES = 1 << 18
# Steps of all frames of a run that steps; about half a second.
STEPS = 2e7
EXACT = "exact"


@dataclass(frozen=True)
class Row:
    """One simulator at one force; `excess` is the share by which its variance is too large."""

    simulator: str
    model: Literal["springs", "bead"]
    axes: int
    steps_per_frame: int | None
    excess: float | None
    frames_per_s: float


def main() -> None:
    """Time all simulators at each force."""
    parser = argparse.ArgumentParser(description="Frames per second of every simulator.")
    parser.add_argument("--force", type=float, nargs="+", default=[1.0, 10.0], help="in pN")
    parser.add_argument("--runs", type=int, default=5, help="of which the fastest counts")
    parser.add_argument("--write", type=Path, help="page to put the block into")
    parser.add_argument(
        "--tweezepy-env",
        type=Path,
        default=Path(tempfile.gettempdir()) / "mtpipe-study-tweezepy",
        help="folder of tweezepy's virtual environment, made if need be (default: %(default)s)",
    )
    choice = parser.parse_args()
    python = tweezepy_python(choice.tweezepy_env)
    parts = [f"{_printed(choice.force, choice.runs)}\n"]
    for force in choice.force:
        rows = [*own_rows(force, choice.runs), tweezepy_row(python, force, choice.runs)]
        parts.append(table(force, rows))
    block = "\n".join(parts)
    print(block)
    if choice.write is not None:
        page = choice.write.read_text(encoding="utf-8")
        place = re.compile(r"(<!-- benchmark -->\n).*?(<!-- end -->)", re.DOTALL)
        page, found = place.subn(lambda m: f"{m[1]}{block}\n{m[2]}", page)
        if found != 1:
            raise SystemExit(f"{choice.write} needs one place <!-- benchmark -->, has {found}")
        choice.write.write_text(page, encoding="utf-8")


def experiment(force_pN: float) -> Experiment:
    """The bead of te Velthuis et al. 2010 in water at 25 °C."""
    return Experiment(
        chain=Chain(2700.0, 50.0, 298.15),
        bead=Bead(1400.0),
        fluid=Fluid(298.15, 0.89),
        along=0,
        camera=CAMERA,
        stage=Stage(),
        tracker=Tracker(),
        rests=(Rest(force_pN, EXACT_FRAMES, 1.0),),
    )


def springs_of(described: Experiment, state: BeadState) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and friction of x, y and z as three springs."""
    energy = described.fluid.thermal_energy_pN_nm
    stiffness = energy / np.diag(state.modes.covariance_nm2())
    return stiffness, np.diag(state.motion.friction)[:3]


def own_rows(force_pN: float, runs: int) -> Iterator[Row]:
    """The simulators of mtpipe: exact, springs step by step, the full bead step by step."""
    described = experiment(force_pN)
    state, energy = bead_state(described, force_pN), described.fluid.thermal_energy_pN_nm
    stiffness, friction = springs_of(described, state)
    random = np.random.default_rng(1)

    def speed(play: Callable[[int], object], frames: int) -> float:
        play(8)  # compiles where need be
        return frames / min(_cpu_s(play, frames) for _ in range(runs))

    def springs(frames: int, axes: int) -> None:
        for k, gamma in zip(stiffness[:axes], friction[:axes], strict=True):
            simulate_axis(k, gamma, energy, CAMERA, frames, random)

    for axes in (1, 3):
        played = speed(lambda n, axes=axes: springs(n, axes), EXACT_FRAMES)
        yield Row(EXACT, "springs", axes, 1, 0.0, played)
    played = speed(lambda n: simulate_motion([(state, n)], CAMERA, random), EXACT_FRAMES)
    yield Row(EXACT, "bead", 3, None, None, played)
    for axes in (1, 3):
        fastest_s = float(np.min(friction[:axes] / stiffness[:axes]))
        for accuracy in ACCURACIES:
            # a hair shorter, as a rounded step is refused where its bias is just above
            step_s = 2 * accuracy * fastest_s * (1 - 1e-9)
            divided = divide_frame(CAMERA, step_s)
            yield Row(
                "step by step", "springs", axes, divided.per_frame,
                divided.time_step_s / fastest_s / 2,
                speed(
                    lambda n, axes=axes, step_s=step_s: simulate_springs(
                        stiffness[:axes], friction[:axes], energy, CAMERA, n, random,
                        time_step_s=step_s,
                    ),
                    math.ceil(STEPS / axes / divided.per_frame),
                ),
            )  # fmt: skip
    bead = BrownianBead(described.chain, force_pN, 1400.0, 0.89)
    divided = divide_frame(CAMERA, longest_time_step_s(bead, CAMERA))
    frames = math.ceil(STEPS / 6 / divided.per_frame)
    played = speed(lambda n: simulate_bead(bead, CAMERA, n, random), frames)
    yield Row("step by step", "bead", 3, divided.per_frame, None, played)


def tweezepy_row(python: Path, force_pN: float, runs: int) -> Row:
    """tweezepy's `downsampled_trace`, by the Python interpreter of its own environment."""
    described = experiment(force_pN)
    stiffness, friction = springs_of(described, bead_state(described, force_pN))
    done = subprocess.run(
        [
            str(python), str(HERE / "tweezepy_trace.py"),
            *map(str, (friction[0], stiffness[0], int(RATE_HZ), int(STEPS / 1000), runs)),
        ],
        capture_output=True, text=True,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"tweezepy_trace.py failed:\n{done.stderr}")
    excess = stiffness[0] / friction[0] / RATE_HZ / 1000 / 2
    speed = json.loads(done.stdout)["frames_per_s"]
    return Row("tweezepy `downsampled_trace`", "springs", 1, 1000, float(excess), speed)


def tweezepy_python(folder: Path) -> Path:
    """The interpreter of the environment that the validation study makes for tweezepy."""
    sys.path.append(str(HERE.parent / "validation"))
    import peers

    return peers.environment(folder)


def table(force_pN: float, rows: list[Row]) -> str:
    """Markdown of the rows of one force, with how many times the exact simulator is faster."""
    exact = {(row.model, row.axes): row.frames_per_s for row in rows if row.simulator == EXACT}
    lines = [
        f"{force_pN:g} pN:\n",
        "| what | axes | simulator | steps per frame | variance too large by |"
        " frames per CPU second | exact is faster by |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in sorted(rows, key=lambda row: (row.model != "springs", row.axes)):
        steps = "" if row.steps_per_frame is None else f"{row.steps_per_frame}"
        excess = "" if row.excess is None else f"{row.excess:.2g}"
        ratio = exact[row.model, row.axes] / row.frames_per_s
        lines.append(
            f"| {row.model} | {row.axes} | {row.simulator} | {steps} | {excess} | "
            f"{row.frames_per_s:.2g} | {'' if row.simulator == EXACT else f'{ratio:.3g}'} |"
        )
    return "\n".join(lines) + "\n"


def _cpu_s(play: Callable[[int], object], frames: int) -> float:
    began = time.process_time()
    play(frames)
    return time.process_time() - began


def _printed(forces: list[float], runs: int) -> str:
    asked = f" --force {' '.join(f'{force:g}' for force in forces)} --runs {runs}"
    return (
        f"Printed {datetime.now(UTC):%Y-%m-%d} by mtpipe {mtpipe.__version__}, Python "
        f"{platform.python_version()} on {platform.machine()}: "
        f"`python workflows/benchmark/simulators.py{asked} --write docs/simulation.md`."
    )


if __name__ == "__main__":
    main()
