"""The simulated counterpart of a recorded bead: same plateaus, same camera, same lost frames.

The whole recording is simulated, moves of the magnets included, so that a plateau begins where the
one before left the bead. The reference's noise goes through the same low-pass as in the recording
and is subtracted. The stage itself is left out: below the cutoff it is subtracted, above it is less
than the noise that the subtraction adds, by the choice of the cutoff.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtpipe.configured.model import LEAST_HEIGHT_STDERR_NM
from mtpipe.crosschecking.case import Case, described
from mtpipe.drift.lowpass import low_pass
from mtpipe.experiment.state import bead_state
from mtpipe.physics.camera import FloatArray
from mtpipe.simulation.linear import simulate_motion

# Moves are cut into stretches of constant force, and longer ones need not be simulated whole.
MOVE_PIECES = 4
LONGEST_MOVE_S = 30.0


@dataclass(frozen=True, eq=False)
class Twin:
    """Simulated traces of all plateaus, as `Case` holds the recorded ones."""

    positions_nm: tuple[FloatArray, ...]
    references_nm: tuple[FloatArray, ...] | None


class TwinMaker:
    """Simulates the fitted experiment again and again."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.experiment = described(case)
        stretches, self.slices = _timetable(case)
        self.stretches = [(bead_state(self.experiment, force), n) for force, n in stretches]

    def draw(self, random: np.random.Generator) -> Twin:
        """Simulate once."""
        case, experiment = self.case, self.experiment
        motion = simulate_motion(self.stretches, experiment.camera, random)
        motion += np.asarray(experiment.tracker.noise_nm) * random.normal(size=motion.shape)
        motion[:, 2] += experiment.optics.z_zero_nm
        rest = np.zeros_like(motion)
        subtraction = case.fit.model.subtraction
        rate = 1 / case.frame_s
        for axis in range(3):
            size = subtraction.noise_nm[axis]
            if size == 0:
                continue
            noise = size * random.normal(size=len(motion))
            slow = low_pass(noise, rate, subtraction.cutoff_hz[axis])
            motion[:, axis] -= slow
            rest[:, axis] = noise - slow
        positions = []
        references = []
        for piece, recorded in zip(self.slices, case.positions_nm, strict=True):
            seen = np.where(np.isfinite(recorded), motion[piece], np.nan)
            # the fit does not believe heights better than this, so neither may the simulation be
            seen[:, 2] += LEAST_HEIGHT_STDERR_NM * random.normal()
            positions.append(seen)
            references.append(rest[piece])
        return Twin(tuple(positions), None if case.references_nm is None else tuple(references))


def _timetable(case: Case) -> tuple[list[tuple[float, int]], list[slice]]:
    """Stretches (force, frames) of the recording, and where its plateaus lie in them."""
    forces = [float(f) for f in case.fit.force_pN]
    stretches: list[tuple[float, int]] = []
    slices: list[slice] = []
    at = 0
    for i, (start, recorded) in enumerate(zip(case.starts, case.positions_nm, strict=True)):
        if i:
            gap = start - case.starts[i - 1] - len(case.positions_nm[i - 1])
            gap = min(max(gap, 0), round(LONGEST_MOVE_S / case.frame_s))
            ratio = math.log(forces[i] / forces[i - 1])
            pieces = [len(p) for p in np.array_split(np.arange(gap), MOVE_PIECES) if len(p)]
            for k, frames in enumerate(pieces):
                force = forces[i - 1] * math.exp(ratio * (k + 0.5) / len(pieces))
                stretches.append((force, frames))
            at += gap
        stretches.append((forces[i], len(recorded)))
        slices.append(slice(at, at + len(recorded)))
        at += len(recorded)
    return stretches, slices
