"""High-pass of the tethered beads themselves: the explicit choice where no bead is a reference.

It removes drift and the bead's own slow fluctuations alike, so a fit must ignore all frequencies
below the cutoff, and a plateau shorter than a few periods of it has little left. x and y are
filtered through the whole recording and keep their mean. z is filtered within each plateau around
the plateau's mean, which is the extension; its drift between plateaus therefore stays.
"""

from __future__ import annotations

import numpy as np

from mtpipe.drift.grid import Grid
from mtpipe.drift.lowpass import low_pass
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import Recording


def slow_motion_nm(recording: Recording, grid: Grid, bead: str, cutoff_hz: float) -> FloatArray:
    """Motion of a bead slower than the cutoff, to be subtracted from it.

    Returns
    -------
    (n_frames, 3) nm; NaN in gaps that cannot be bridged; 0 for z outside plateaus.
    """
    slow = np.zeros((len(grid.row), 3))
    for axis in (0, 1):
        series = grid.series_nm(recording, bead, axis)
        whole = low_pass(series, grid.rate_hz, cutoff_hz)[grid.row]
        slow[:, axis] = whole - _mean(recording.positions_nm[bead][:, axis])
    for plateau in recording.plateaus:
        trace = recording.trace_nm(bead, plateau)[:, 2]
        rows = slice(plateau.start, plateau.stop)
        place = recording.frame[rows] - recording.frame[plateau.start]
        slow[rows, 2] = low_pass(trace, grid.rate_hz, cutoff_hz)[place] - _mean(trace)
    return slow


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else 0.0
