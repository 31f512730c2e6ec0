"""From simulated motion to recorded positions: the later steps of a recording, played in time.

The same steps as `mtpipe.experiment.readout` has as covariances, in the same order.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mtpipe.experiment.description import Experiment
from mtpipe.experiment.readout import (
    COURSE_POINTS,
    force_course,
    height_by_tether_nm,
    height_weights,
)
from mtpipe.experiment.state import all_states
from mtpipe.experiment.step import Place, by_plateau
from mtpipe.ground.types import FloatArray
from mtpipe.physics.langevin import simulate_mode
from mtpipe.physics.lost_frames import wave_hz_by_frames
from mtpipe.physics.normal_numbers import standard_normal

# Most and least stretches of constant force for a plateau whose force changes, and the change in ln
# F per stretch that decides between. The course of the height is followed within stretches.
MOST_PIECES, FEWEST_PIECES, PIECE_CHANGE = 24, 4, 0.05
# Forces at which the heights that steps of the tether add are calculated; linear between them.
ADDED_POINTS = 201


def force_pieces(experiment: Experiment, plateau: int, frames: int) -> list[tuple[float, int]]:
    """Stretches of constant force that a plateau is played in: force over its mean, less 1, and
    number of frames.
    """
    course = experiment.magnets.course(plateau)
    if course.relative_change == 0:
        return [(0.0, frames)]
    relative = force_course(course, frames)
    if course.kind == "step":
        edges = [0, round(course.at * frames), frames]
    else:
        # it rises or falls all along, and by as much in one piece as in another
        changed = np.abs(np.log1p(relative) - np.log1p(relative[0]))
        pieces = min(max(math.ceil(changed[-1] / PIECE_CHANGE), FEWEST_PIECES), MOST_PIECES)
        passed = np.searchsorted(changed, np.linspace(0, changed[-1], pieces + 1)[1:-1])
        edges = [0, *passed.tolist(), frames]
    return [(float(relative[a:b].mean()), b - a) for a, b in itertools.pairwise(edges) if b > a]


def height_within_pieces(
    experiment: Experiment, plateau: int, force_pN: float, frames: int
) -> FloatArray:
    """(frames,) nm: what the mean height of the force's course is above that of its pieces, with
    what steps of the tether add.
    """
    pieces = force_pieces(experiment, plateau, frames)
    if len(pieces) <= 2:
        return np.zeros(frames)
    relative = force_course(experiment.magnets.course(plateau), frames)
    constant = np.repeat([change for change, _ in pieces], [n for _, n in pieces])
    nodes = np.linspace(relative.min(), relative.max(), COURSE_POINTS)
    experiment = experiment.in_plateau(plateau)
    states = all_states(experiment, (force_pN * (1 + nodes)).tolist())
    heights = np.array([state.extension_nm for state in states])
    within = heights @ (height_weights(nodes, relative) - height_weights(nodes, constant))
    if any(step.place == "tether" for step in experiment.steps):
        points = np.linspace(relative.min(), relative.max(), ADDED_POINTS)
        forces = (force_pN * (1 + points)).tolist()
        means = [height_by_tether_nm(experiment, force) for force in forces]
        within += np.interp(relative, points, means) - np.interp(constant, points, means)
    return np.asarray(within)


def recorded(
    motion_nm: FloatArray,
    force_pN: FloatArray,
    experiment: Experiment,
    random: np.random.Generator,
    plateaus: Sequence[slice] = (),
) -> FloatArray:
    """(frames, 3) positions as recorded, without stage, reference and lost frames.

    Parameters
    ----------
    motion_nm : (frames, 3) averaged over each exposure. force_pN : (frames,) that acts.
    plateaus : their rows, for steps that are another in each.
    """
    camera, frames = experiment.camera, len(motion_nm)
    seen = _played(motion_nm, "tether", force_pN, experiment, random, plateaus)
    seen = seen @ experiment.optics.matrix.T
    seen = _played(seen, "optics", force_pN, experiment, random, plateaus)
    walk = np.asarray(experiment.stage.unsubtracted_nm_per_root_s)
    if walk.any():
        steps = standard_normal(random, (frames, 3))
        steps *= math.sqrt(camera.frame_s) * walk
        seen += np.cumsum(steps, axis=0, out=steps)
    time_s = camera.frame_s * np.arange(frames)[:, None]
    share = experiment.clock.dropped_share
    for line in experiment.stage.lines:
        phase = 2 * np.pi * random.random(3)
        if math.isfinite(line.coherence_s):
            step = math.sqrt(2 * camera.frame_s / line.coherence_s)
            phase = phase + np.cumsum(step * standard_normal(random, seen.shape), axis=0)
        hz = wave_hz_by_frames(line.frequency_hz, camera.frame_s, share)
        wave = np.sin(2 * np.pi * hz * time_s + phase)
        # near half the frame rate a wave's phase decides how much of it is recorded, and a line's
        # amplitude is of what is recorded
        wave /= np.sqrt(2 * np.mean(wave**2, axis=0))
        seen += np.asarray(line.amplitude_nm) * wave
    noise = standard_normal(random, seen.shape)
    noise *= np.asarray(experiment.tracker.noise_nm)
    seen += noise
    seen = _played(seen, "tracker", force_pN, experiment, random, plateaus)
    seen[:, 2] += experiment.optics.z_zero_nm
    return np.asarray(seen)


def _played(
    position_nm: FloatArray,
    place: Place,
    force_pN: FloatArray,
    experiment: Experiment,
    random: np.random.Generator,
    plateaus: Sequence[slice],
) -> FloatArray:
    """(frames, 3) positions behind all steps of one place."""
    camera, energy = experiment.camera, experiment.fluid.thermal_energy_pN_nm
    for step in experiment.steps:
        if step.place == place:
            position_nm = step.played(position_nm, force_pN, camera, energy, random)
            if by_plateau(step):
                position_nm = position_nm.copy()
                for i, rows in enumerate(plateaus):
                    here = step.in_plateau(i)
                    position_nm[rows] = here.played(
                        position_nm[rows], force_pN[rows], camera, energy, random
                    )
    return position_nm


def reference_motion(
    experiment: Experiment, frames: int, random: np.random.Generator
) -> FloatArray:
    """(frames, 3) motion of the reference bead by itself, as recorded."""
    stage = experiment.stage
    return np.column_stack(
        [
            simulate_mode(size**2, stage.reference_s, experiment.camera, frames, random)
            if size > 0
            else np.zeros(frames)
            for size in stage.reference_nm
        ]
    )


def kept_frames(
    frames: int, dropped_share: float, random: np.random.Generator
) -> NDArray[np.int64]:
    """(frames,) which of the camera's frames the file's rows are, when frames are dropped."""
    if dropped_share <= 0:
        return np.arange(frames)
    gaps = random.geometric(1 - dropped_share, size=frames)
    return np.asarray(np.cumsum(gaps) - gaps[0])
