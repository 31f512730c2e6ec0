"""The loop over time of `mtpipe.simulation.rocking`, compiled."""

from __future__ import annotations

import numpy as np

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray


@compiled
def follow(
    start: FloatArray,
    frames: int,
    exposed: int,
    decay: FloatArray,
    spread: FloatArray,
    average: FloatArray,
    slope: FloatArray,
    rest: FloatArray,
    pushed: FloatArray,
    pushed_average: FloatArray,
    amplitude: FloatArray,
    stretch: FloatArray,
    bends: FloatArray,
    push: FloatArray,
    lowest: float,
    nodes_per_nm: float,
    random: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """(frames, 3) recorded motion by d modes, and the modes at its end.

    Parameters
    ----------
    start : (d,) modes. exposed : of the (parts,) steps of a frame, the first ones.
    decay, spread, average, slope, rest, pushed, pushed_average : (parts, d) of each step: what is
        left of a mode, what is drawn, the mean over the step of a mode, by what was drawn, and
        what is its own; what a push of 1 pN on the tether's length adds to mode and mean.
    amplitude : (3, d) of x, y, z. stretch : (d,) of the tether's length. bends : (d, d).
    push : (nodes,) beyond the harmonic force, at lengths from the lowest one on.
    """
    modes = start.copy()
    mean = np.empty_like(modes)
    recorded = np.zeros((frames, 3))
    last = len(push) - 1
    for frame in range(frames):
        for part in range(len(decay)):
            length = 0.0
            for i in range(len(modes)):
                length += stretch[i] * modes[i]
            place = min(max(nodes_per_nm * (length - lowest), 0.0), last - 1e-9)
            node = int(place)
            force = push[node] + (place - node) * (push[node + 1] - push[node])
            for i in range(len(modes)):
                drawn = random.standard_normal()
                if part < exposed:
                    mean[i] = (
                        average[part, i] * modes[i]
                        + pushed_average[part, i] * force
                        + slope[part, i] * drawn
                        + rest[part, i] * random.standard_normal()
                    )
                modes[i] = decay[part, i] * modes[i] + pushed[part, i] * force
                modes[i] += spread[part, i] * drawn
            if part < exposed:
                for i in range(len(modes)):
                    for axis in range(3):
                        recorded[frame, axis] += amplitude[axis, i] * mean[i]
                    for j in range(len(modes)):
                        recorded[frame, 2] += 0.5 * bends[i, j] * mean[i] * mean[j]
        recorded[frame] /= exposed
    return recorded, modes
