"""Plateaus moved to where the beads change, where the log is elsewhere."""

from __future__ import annotations

import math
from dataclasses import replace

from mtpipe.recording.recording import Plateau, Recording
from mtpipe.states.lag import Lag

# Standard errors of a change's time that are left out on both sides of it.
MARGIN_SIGMAS = 3.0
# A dwell that the correction shortens is still one as long as this share of the shortest is left.
LEAST_SHARE = 0.5


def moved_plateaus(recording: Recording, lag: Lag) -> list[Plateau | None]:
    """The plateaus by the beads' own changes, None for one that vanishes.

    A plateau that begins with the recording or ends with it keeps that end. Where the first begins
    later, or the last ends earlier, the magnets moved there as well, from or to a dwell that is no
    plateau: the lag of the nearest edge counts there, if it is that of all, as far as it makes the
    plateau shorter. Rows between which a change may be are in no plateau; settling times stay as
    long as they were.
    """
    old = recording.plateaus
    frame_s = float(recording.time_s[-1] - recording.time_s[0]) / (len(recording.time_s) - 1)
    least = LEAST_SHARE * recording.setup.plateaus.minimum_s / frame_s
    rows = len(recording.time_s)
    moved: list[Plateau | None] = []
    for i, plateau in enumerate(old):
        start, stop = plateau.start, plateau.stop
        before, after = max(i - 1, 0), min(i, len(old) - 2)
        later = math.ceil(lag.shift[before] + _margin(lag, before))
        earlier = math.floor(lag.shift[after] - _margin(lag, after))
        if i > 0 and lag.shift[before] != 0:
            start += later
        elif i == 0 and start > 0 and _is_common(recording, lag, before):
            start += max(later, 0)
        if i < len(old) - 1 and lag.shift[after] != 0:
            stop += earlier
        elif i == len(old) - 1 and stop < rows and _is_common(recording, lag, after):
            stop += min(earlier, 0)
        start, stop = max(start, 0), min(stop, rows)
        found = replace(plateau, start=start, stop=stop)
        moved.append(found if stop - start >= max(least, 2) else None)
    return moved


def _is_common(recording: Recording, lag: Lag, edge: int) -> bool:
    """Whether an edge has the lag that all have, and there is one."""
    return bool(lag.shift[edge] != 0) and recording.plateaus[edge].number not in lag.own


def _margin(lag: Lag, edge: int) -> float:
    return MARGIN_SIGMAS * float(lag.error[edge]) + 1
