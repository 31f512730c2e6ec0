"""The loop in time of `mtpipe.physics.langevin`, compiled."""

from __future__ import annotations

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray


@compiled
def follow(
    kick: FloatArray,
    average: FloatArray,
    kick_size: FloatArray,
    average_size: FloatArray,
    slope: FloatArray,
    carried_by: FloatArray,
    part_decay: float,
    frame_decay: float,
    edge: float,
    start: float,
) -> float:
    """Turn standard normal numbers into a mode's averages over parts of exposures, in place.

    Parameters
    ----------
    kick, average : (parts, frames) random numbers; `average` becomes the averages.
    kick_size, average_size : (parts,) standard deviations of what is drawn.
    slope : (parts,) of an average against the kick. carried_by : (parts,) what is left of a kick at
        the end of the frame.
    part_decay, frame_decay : what is left of a position after a part, after a frame.
    edge : of a position in the average over the part it begins. start : position at first.

    Returns
    -------
    Position at the start of the frame that would follow.
    """
    parts, frames = kick.shape
    here = start
    for frame in range(frames):
        last = kick_size[parts - 1] * kick[parts - 1, frame]
        carried = last
        at = here
        for part in range(parts - 1):
            moved = kick_size[part] * kick[part, frame]
            carried += carried_by[part] * moved
            own = average_size[part] * average[part, frame] + slope[part] * moved
            average[part, frame] = own + edge * at
            at = part_decay * at + moved
        own = average_size[parts - 1] * average[parts - 1, frame] + slope[parts - 1] * last
        average[parts - 1, frame] = own + edge * at
        here = carried + frame_decay * here
    return here
