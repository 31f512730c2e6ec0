"""Extension against turns: the stretches of a recording in which the magnets rotate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Recording

# Turns from end to end; less shows no shape.
FEWEST_TURNS = 3.0
# Points of a curve; with fewer, nothing is left beside what is fitted.
FEWEST_POINTS = 6
# Frames of a point: a step of the motor takes fewer, and is no turning.
FEWEST_FRAMES = 8


@dataclass(frozen=True)
class Turned:
    """A bead's extension while the magnets rotate at one position.

    Attributes
    ----------
    bead, magnet_mm, start_s, end_s : whose, where and when; `magnet_mm` None where it is not known.
    turns, extension_nm : (n,) in time order, a point for each turn that was passed or waited at.
    """

    bead: str
    magnet_mm: float | None
    start_s: float
    end_s: float
    turns: FloatArray
    extension_nm: FloatArray


def turned_stretches(recording: Recording) -> Iterator[Turned]:
    """Curves of every tethered bead with heights, by stretches in which the magnets only rotate.

    A point is the median height while the magnets are within half a turn of a whole one: what
    follows the angle once a turn, as the height of a bead that is recorded askew, is not in it.

    Parameters
    ----------
    recording : drift already subtracted.
    """
    turns = recording.magnet_turns
    if turns is None:
        return
    at_once = recording.setup.plateaus.model_copy(update={"minimum_s": 0.0, "settle_s": 0.0})
    for rest in find_plateaus(recording.time_s, recording.magnet_mm, at_once):
        rows = slice(rest.start, rest.stop)
        mine = turns[rows]
        if not np.isfinite(mine).any() or np.nanmax(mine) - np.nanmin(mine) < FEWEST_TURNS:
            continue
        start_s, end_s = recording.time_s[[rest.start, rest.stop - 1]].tolist()
        for bead in recording.tethered:
            at, height = _points(mine, recording.positions_nm[bead][rows, 2])
            if len(at) >= FEWEST_POINTS and np.ptp(at) >= FEWEST_TURNS:
                yield Turned(bead, rest.magnet_mm, start_s, end_s, at, height)


def _points(turns: FloatArray, z_nm: FloatArray) -> tuple[FloatArray, FloatArray]:
    known = np.isfinite(turns) & np.isfinite(z_nm)
    turns, z_nm = turns[known], z_nm[known]
    edges = np.flatnonzero(np.diff(np.round(turns))) + 1
    pieces = zip(np.split(turns, edges), np.split(z_nm, edges), strict=True)
    points = [(np.mean(t), np.median(z)) for t, z in pieces if len(t) >= FEWEST_FRAMES]
    found = np.array(points, dtype=np.float64).reshape(-1, 2)
    return found[:, 0], found[:, 1]
