"""Exact simulator of a tethered bead before a camera: every mode in one step per frame.

A frame costs the same whatever the stiffness. Second-order statistics (spectra, variances,
correlations between axes) are those of the closed forms exactly; z has the skewness of the chain
and of the swinging tether. What is not in it (kurtosis, the surface as a wall, friction that
follows the momentary height) is in `mtpipe.simulation.brownian`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.sparse.csgraph import connected_components

from mtpipe.experiment.state import UP, BeadState
from mtpipe.physics.camera import Camera, FloatArray, blur_factor
from mtpipe.physics.langevin import mode_path

# Squares of a coordinate are averaged over parts of the exposure, each at most this many relaxation
# times long: the part's own spread is then put in by its mean, and only its fluctuation, below 3 %
# of the square's variance, is left out. Faster modes average out over the exposure.
PART_RELAXATIONS = 0.5
MOST_PARTS = 6
# Below this share of the largest, an element of the bending is rounding error.
BENDS = 1e-10


def simulate_motion(
    stretches: Sequence[tuple[BeadState, int]], camera: Camera, random: np.random.Generator
) -> FloatArray:
    """Recorded motion of one bead through stretches of constant force.

    Parameters
    ----------
    stretches : state of the bead and number of frames, in time order. The first starts in
        equilibrium, every other where the one before left the bead.

    Returns
    -------
    (frames, 3) x, y, z in nm, averaged over each exposure; z from the surface, x and y about the
    anchor.
    """
    pieces = []
    position: FloatArray | None = None
    for state, frames in stretches:
        start: FloatArray | None = None
        if position is not None:
            start = np.linalg.solve(state.modes.shape, position - _mean(state))
        motion, end = _stretch(state, camera, frames, random, start)
        pieces.append(motion)
        position = np.asarray(state.modes.shape @ end) + _mean(state)
    return np.vstack(pieces)


def _mean(state: BeadState) -> FloatArray:
    """(d,) mean of the coordinates, measured from the anchor."""
    mean = np.zeros(len(state.modes.tau_s))
    mean[UP] = state.extension_nm
    return mean


def _stretch(
    state: BeadState,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    start: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """(frames, 3) motion, and the modes at its end."""
    modes = state.modes
    q = modes.quadratic(state.bending)
    recorded = np.zeros((3, frames))
    recorded[2] = state.extension_nm
    end = np.empty(len(modes.tau_s))
    for block in _blocks(q):
        # the mode that bends z most sets how finely its square is followed
        leading = max(block, key=lambda i: abs(q[i, i]))
        part_count = _parts(camera.exposure_s / float(modes.tau_s[leading]))
        paths = {
            i: mode_path(
                float(modes.tau_s[i]),
                camera,
                frames,
                random,
                start=None if start is None else float(start[i]),
                parts=part_count,
            )
            for i in block
        }
        for i in block:
            end[i] = paths[i].end
            mean = paths[i].averages.mean(axis=0)
            for axis in np.flatnonzero(modes.amplitude_nm[:, i]):
                recorded[axis] += modes.amplitude_nm[axis, i] * mean
            for j in block:
                if j < i:
                    continue
                product = np.mean(paths[i].averages * paths[j].averages, axis=0)
                if i == j:
                    # a part's mean square lacks the spread within the part
                    part_s = camera.exposure_s / part_count
                    product -= float(blur_factor(part_s / modes.tau_s[i]))
                recorded[2] += q[i, j] * (0.5 if i == j else 1.0) * product
    return recorded.T, end


def _parts(relaxations: float) -> int:
    return min(max(math.ceil(relaxations / PART_RELAXATIONS), 1), MOST_PARTS)


def _blocks(q: FloatArray) -> list[list[int]]:
    """Modes that bend z together; modes that do not bend it stand alone."""
    _, block_of = connected_components(np.abs(q) > BENDS * np.abs(q).max(), directed=False)
    return [np.flatnonzero(block_of == block).tolist() for block in range(block_of.max() + 1)]
