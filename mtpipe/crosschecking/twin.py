"""The simulated counterpart of a recorded bead: same plateaus, same camera, same lost frames.

The whole recording is simulated, moves of the magnets included, so that a plateau begins where the
one before left the bead. Bead and reference share a stage that moves at random as in the recording;
the reference, with its noise, goes through the same low-pass and is subtracted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtpipe.crosschecking.prepared_bead import PreparedBead, described
from mtpipe.drift.lowpass import low_pass
from mtpipe.experiment.description import Allowance, Experiment
from mtpipe.experiment.state import states_in
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.expectation import LEAST_HEIGHT_STDERR_NM
from mtpipe.joint_fit.known_forces import prior_scatter, relative_stderr
from mtpipe.joint_fit.parameters import UPWARD_FRICTION_STDERR, UPWARD_VARIANCE_STDERR
from mtpipe.physics.normal_numbers import standard_normal
from mtpipe.simulation.linear import simulate_motion
from mtpipe.simulation.readout import (
    force_pieces,
    height_within_pieces,
    kept_frames,
    recorded,
    reference_motion,
)

# Moves are cut into stretches of constant force, and longer ones need not be simulated whole.
MOVE_PIECES = 4
LONGEST_MOVE_S = 30.0
# Errors of z's friction and variance that are simulated, in standard errors: four equally likely
# pairs of about unit variance and no correlation.
VARIANTS = ((1.4, 0.0), (-1.4, 0.0), (0.0, 1.4), (0.0, -1.4))


@dataclass(frozen=True, eq=False)
class Twin:
    """Simulated traces of all plateaus, as `PreparedBead` holds the recorded ones.

    `ln_force_misstated` (plateaus,) : ln of what its setup would state of the forces, over the
    forces simulated; errors of what else the setup states go into it. nan where it states none.
    """

    positions_nm: tuple[FloatArray, ...]
    references_nm: tuple[FloatArray, ...] | None
    ln_force_misstated: FloatArray


class TwinMaker:
    """Simulates the fitted experiment again and again."""

    def __init__(self, case: PreparedBead) -> None:
        self.case = case
        self.experiment = described(case)
        # where frames are dropped, more have to be simulated than the file has
        self.stretch = 1 / (1 - self.experiment.clock.dropped_share)
        stretches, plateaus, self.slices, self.first_of, self.moves = _timetable(
            case, self.experiment, self.stretch
        )
        self.within_nm = np.zeros(sum(n for _, n in stretches))
        for i, piece in enumerate(self.slices):
            force_pN, length = float(case.fit.force_pN[i]), piece.stop - piece.start
            self.within_nm[piece] = height_within_pieces(self.experiment, i, force_pN, length)
        # simulations draw for each plateau how far z's friction and variance are from theory
        forces, frames = [force for force, _ in stretches], [n for _, n in stretches]
        self.variants = [
            list(zip(states_in(other, forces, plateaus), frames, strict=True))
            for other in _varied(self.experiment)
        ]
        self.force_pN = np.repeat(forces, frames)
        self.middles_nm = [np.nanmean(real[:, :2], axis=0) for real in case.positions_nm]
        self.lost = [np.isnan(real) for real in case.positions_nm]

    def draw(self, random: np.random.Generator) -> Twin:
        """Simulate once."""
        case, experiment = self.case, self.experiment
        # theory is off by the same all through a plateau
        chosen = random.integers(len(self.variants), size=len(self.variants[0]))[self.first_of]
        stretches = [self.variants[k][i] for i, k in enumerate(chosen)]
        motion = simulate_motion(stretches, experiment.camera, random, unseen=self.moves)
        motion[:, 2] += self.within_nm
        motion = recorded(motion, self.force_pN, experiment, random, self.slices)
        own = reference_motion(experiment, len(motion), random)
        rest = np.zeros_like(motion)
        subtraction = case.fit.model.subtraction
        rate = 1 / case.frame_s
        for axis in range(3):
            noise_nm, cutoff_hz = subtraction.noise_nm[axis], subtraction.cutoff_hz[axis]
            walk_nm = subtraction.stage_nm_per_root_s[axis]
            if noise_nm == 0 and walk_nm == 0 and not own[:, axis].any():
                continue
            stage = standard_normal(random, len(motion))
            np.cumsum(stage, out=stage)
            stage *= walk_nm * math.sqrt(case.frame_s)
            reference = standard_normal(random, len(motion))
            reference *= noise_nm
            reference += stage
            reference += own[:, axis]
            slow = low_pass(reference, rate, cutoff_hz)
            motion[:, axis] += stage - slow
            rest[:, axis] = reference - slow
        positions = []
        references = []
        dropped = experiment.clock.dropped_share
        still = ~rest.any(axis=0)
        pieces = zip(self.slices, self.lost, self.middles_nm, strict=True)
        for i, (piece, lost, middle_nm) in enumerate(pieces):
            rows = np.minimum(kept_frames(len(lost), dropped, random), piece.stop - piece.start - 1)
            seen = motion[piece][rows]
            seen[lost] = np.nan
            seen[:, :2] += middle_nm
            # the fit does not believe heights better than this, so neither may the simulation be
            seen[:, 2] += LEAST_HEIGHT_STDERR_NM * random.normal()
            positions.append(seen)
            references.append(rest[piece][rows])
            if case.references_nm is not None:
                # of what a reference does that the experiment does not have, its simulations say
                # nothing; what was recorded of it has nothing to do with their bead
                references[i][:, still] = case.references_nm[i][:, still]
        return Twin(
            tuple(positions),
            None if case.references_nm is None else tuple(references),
            self._ln_force_misstated(random),
        )

    def _ln_force_misstated(self, random: np.random.Generator) -> FloatArray:
        fit = self.case.fit
        if not fit.model.known_forces:
            return np.full(fit.model.plateaus, np.nan)
        stated = relative_stderr(fit.model.known_forces) * random.normal()
        return np.asarray(stated + prior_scatter(fit, random))


def _varied(experiment: Experiment) -> list[Experiment]:
    """The experiment with z's friction and variance off by up to what is allowed."""
    allowance = experiment.allowance
    return [
        replace(
            experiment,
            allowance=Allowance(
                allowance.upward_friction * math.exp(a * UPWARD_FRICTION_STDERR),
                allowance.upward_variance * math.exp(b * UPWARD_VARIANCE_STDERR),
            ),
        )
        for a, b in VARIANTS
    ]


def _timetable(
    case: PreparedBead, experiment: Experiment, stretch: float
) -> tuple[list[tuple[float, int]], list[int], list[slice], NDArray[np.int64], set[int]]:
    """Stretches (force, frames) of the recording, the plateau that each is of or leads to, where
    plateaus lie in them, of each stretch the first one of its plateau (of a move it is itself), and
    which are moves.

    Parameters
    ----------
    stretch : how many times longer a plateau is simulated than it was recorded.
    """
    forces = [float(f) for f in case.fit.force_pN]
    stretches: list[tuple[float, int]] = []
    plateaus: list[int] = []
    slices: list[slice] = []
    first_of: list[int] = []
    moves: set[int] = set()
    at = 0
    for i, (start, real) in enumerate(zip(case.starts, case.positions_nm, strict=True)):
        if i:
            gap = start - case.starts[i - 1] - len(case.positions_nm[i - 1])
            gap = min(max(gap, 0), round(LONGEST_MOVE_S / case.frame_s))
            ratio = math.log(forces[i] / forces[i - 1])
            pieces = [len(p) for p in np.array_split(np.arange(gap), MOVE_PIECES) if len(p)]
            for k, frames in enumerate(pieces):
                force = forces[i - 1] * math.exp(ratio * (k + 0.5) / len(pieces))
                stretches.append((force, frames))
            at += gap
        frames = len(real) if stretch == 1 else math.ceil(1.05 * stretch * len(real)) + 50
        moves |= set(range(len(first_of), len(stretches)))
        first_of += range(len(first_of), len(stretches))
        parts = force_pieces(experiment, i, frames)
        first_of += [len(stretches)] * len(parts)
        stretches += [(forces[i] * (1 + part), rows) for part, rows in parts]
        plateaus += [i] * (len(stretches) - len(plateaus))
        slices.append(slice(at, at + frames))
        at += frames
    return stretches, plateaus, slices, np.array(first_of), moves
