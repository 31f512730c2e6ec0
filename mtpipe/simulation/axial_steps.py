"""The loop in time of `mtpipe.simulation.axial`, compiled."""

from __future__ import annotations

import numpy as np

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray


@compiled
def averaged_heights(
    move: FloatArray,
    spread: FloatArray,
    low: float,
    high: float,
    start: float,
    frames: int,
    steps: int,
    exposed: int,
    random: np.random.Generator,
) -> tuple[FloatArray, float]:
    """(frames,) means over the first `exposed` of `steps` steps, and the last height.

    With none exposed, the heights at the start of each frame.
    """
    heights = np.empty(frames)
    scale = (len(move) - 1) / (high - low)
    z = start
    for frame in range(frames):
        heights[frame] = z
        total = 0.0
        bridged = 0.0
        for step in range(steps):
            before = z
            at = (z - low) * scale
            i = min(int(at), len(move) - 2)
            part = at - i
            mean = move[i] + part * (move[i + 1] - move[i])
            size = spread[i] + part * (spread[i + 1] - spread[i])
            z = z + mean + size * random.standard_normal()
            if z < low:
                z = 2 * low - z
            if z > high:
                z = 2 * high - z
            z = min(max(z, low), high)
            if step < exposed:
                total += 0.5 * (before + z)
                bridged += size * size
        # between two steps a path scatters about a straight line by a twelfth of their variance
        if exposed > 0:
            heights[frame] = (
                total / exposed + np.sqrt(bridged / 12) / exposed * random.standard_normal()
            )
    return heights, z
