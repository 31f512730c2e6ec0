"""Plateaus moved to where the beads change, where the log is elsewhere."""

from __future__ import annotations

import math
from dataclasses import replace

from mtpipe.recording import Plateau, Recording
from mtpipe.states.lag import Lag

# Standard errors of a change's time that are left out on both sides of it.
MARGIN_SIGMAS = 3.0
# A dwell that the correction shortens is still one as long as this share of the shortest is left.
LEAST_SHARE = 0.5


def moved_plateaus(recording: Recording, lag: Lag) -> list[Plateau | None]:
    """The plateaus by the beads' own changes, None for one that vanishes.

    A plateau that begins with the recording or ends with it keeps that end. Rows between which a
    change may be are in no plateau; settling times stay as long as they were.
    """
    old = recording.plateaus
    frame_s = float(recording.time_s[-1] - recording.time_s[0]) / (len(recording.time_s) - 1)
    least = LEAST_SHARE * recording.setup.plateaus.minimum_s / frame_s
    rows = len(recording.time_s)
    moved: list[Plateau | None] = []
    for i, plateau in enumerate(old):
        start, stop = plateau.start, plateau.stop
        if i > 0 and lag.shift[i - 1] != 0:
            start += math.ceil(lag.shift[i - 1] + _margin(lag, i - 1))
        if i < len(old) - 1 and lag.shift[i] != 0:
            stop += math.floor(lag.shift[i] - _margin(lag, i))
        start, stop = max(start, 0), min(stop, rows)
        found = replace(plateau, start=start, stop=stop)
        moved.append(found if stop - start >= max(least, 2) else None)
    return moved


def _margin(lag: Lag, edge: int) -> float:
    return MARGIN_SIGMAS * float(lag.error[edge]) + 1
