"""Whether a hidden step that study.py misses could have been seen, and how plainly.

    python workflows/plateaus/resolvable.py 16 47 95

Of each recording (a seed of study.py with a hidden step) the dwell that holds the step is simulated
again with its beads, references, noise and drift, with the step and without. Looked at is what an
observer sees who is told when it happened: by how much the mean height changes, averaged over
beads, after drift subtraction. Printed are that change, its standard deviation from simulation to
simulation, and the mean log-likelihood ratio of a step of that size against none, half the square
of their ratio; beside it the recording's own change. docs/plateaus.md has the figures.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import study

from mtpipe.drift import subtract_drift
from mtpipe.experiment.description import Experiment
from mtpipe.ground.types import FloatArray
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Plateau, Recording
from mtpipe.setup.setup import Setup
from mtpipe.simulation.simulate import simulate_experiment


def main() -> None:
    """Simulate and print, a line per seed."""
    parser = argparse.ArgumentParser(description="How plain hidden steps are.")
    parser.add_argument("seeds", type=int, nargs="+", help="of study.py, with a hidden step")
    parser.add_argument(
        "--count", type=int, default=20, help="simulations with a step, and without"
    )
    choice = parser.parse_args()
    for seed in choice.seeds:
        print(line(seed, choice.count), flush=True)


def line(seed: int, count: int) -> str:
    """What is printed of one recording."""
    # the drawing of a recording keeps no description of it, which is what is simulated again
    with patch.object(study, "simulate_experiment", wraps=simulate_experiment) as simulated:
        case = study.drawn(seed)
    experiment, setup, _ = simulated.call_args.args
    if case.kind != "hidden":
        raise SystemExit(f"seed {seed} has no hidden step: {case.kind}")
    recording = subtract_drift(case.recording)
    plateau = max(recording.plateaus, key=lambda one: np.ptp(_log_force(case.force_pN, one)))
    changes = np.flatnonzero(np.diff(_log_force(case.force_pN, plateau)))
    parts = (int(changes[0]) + 1, int(changes[-1]) + 1)
    force = case.force_pN[plateau.start]
    place = int(np.argmin([abs(rest.force_pN - force) for rest in experiment.rests]))
    random = np.random.default_rng(seed)
    with_step = _changes(_dwell(experiment, place, stepped=True), setup, parts, count, random)
    without = _changes(_dwell(experiment, place, stepped=False), setup, parts, count, random)
    expected = with_step.mean() - without.mean()
    sd = float(np.sqrt((with_step.var(ddof=1) + without.var(ddof=1)) / 2))
    return (
        f"seed {seed}: {100 * case.step:+.0f} % of {force:.2f} pN, "
        f"{len(recording.tethered)} beads: heights change by {expected:+.0f} nm, "
        f"standard deviation {sd:.0f} nm, log-likelihood ratio {(expected / sd) ** 2 / 2:.1f}; "
        f"in the recording by {height_change(recording, plateau, parts):+.0f} nm"
    )


def height_change(recording: Recording, plateau: Plateau, parts: tuple[int, int]) -> float:
    """Change of mean height in nm, averaged over beads.

    parts : frames of the plateau at which the first state ends and the second begins.
    """
    heights = [recording.trace_nm(bead, plateau)[:, 2] for bead in recording.tethered]
    return float(np.mean([np.mean(z[parts[1] :]) - np.mean(z[: parts[0]]) for z in heights]))


def _log_force(force_pN: FloatArray, plateau: Plateau) -> FloatArray:
    return np.asarray(np.log(force_pN[plateau.start : plateau.stop]))


def _dwell(experiment: Experiment, place: int, *, stepped: bool) -> Experiment:
    """The dwell alone, with its step or with one force throughout."""
    first, second = experiment.rests[place : place + 2]
    if not stepped:
        second = replace(second, force_pN=first.force_pN)
    return replace(experiment, rests=(first, second))


def _changes(
    experiment: Experiment,
    setup: Setup,
    parts: tuple[int, int],
    count: int,
    random: np.random.Generator,
) -> FloatArray:
    """(count,) changes of height of simulated recordings, in nm."""
    found = []
    for _ in range(count):
        recording = simulate_experiment(experiment, setup, random)
        # one plateau, as by the log that does not show the step
        magnet = np.zeros(len(recording.time_s))
        plateaus = find_plateaus(recording.time_s, magnet, setup.plateaus)
        recording = subtract_drift(replace(recording, magnet_mm=magnet, plateaus=plateaus))
        found.append(height_change(recording, recording.plateaus[0], parts))
    return np.array(found)


if __name__ == "__main__":
    main()
