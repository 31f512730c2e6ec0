"""Traces: one bead in one plateau, on the camera's grid, mistracked frames blanked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.physics.mistracking import without_mistracked
from mtpipe.recording.recording import Plateau, Recording

STEP_FRAMES = 50


@dataclass(frozen=True)
class Trace:
    """One bead in one plateau, cleaned: (n_frames, 3) nm on the camera's grid, NaN where lost.

    `stage_z_nm` is how far the drift that was subtracted moved in z during the plateau,
    `stage_step_nm` how far it stepped in z since the end of the plateau before.
    """

    plateau: Plateau
    start_s: float
    position_nm: FloatArray
    mistracked: int
    stage_z_nm: float
    stage_step_nm: float

    @property
    def recorded(self) -> tuple[bool, bool, bool]:
        """Per axis, whether there is any position at all."""
        seen = np.isfinite(self.position_nm)
        return (bool(seen[:, 0].any()), bool(seen[:, 1].any()), bool(seen[:, 2].any()))

    def lost_on(self, axis: int) -> int:
        """Frames without a position on one axis."""
        return int(np.sum(~np.isfinite(self.position_nm[:, axis])))

    @property
    def lost(self) -> int:
        """Frames without a position on at least one of the axes recorded."""
        seen = np.isfinite(self.position_nm[:, list(self.recorded)])
        return int(np.sum(~seen.all(axis=1)))


def traces_of(recording: Recording, bead: str) -> list[Trace]:
    """The traces of a bead in all plateaus, mistracked frames blanked."""
    traces = []
    for plateau in recording.plateaus:
        position, mistracked = without_mistracked(recording.trace_nm(bead, plateau))
        start_s = float(recording.time_s[plateau.start])
        moved, stepped = _stage_z(recording, plateau)
        traces.append(Trace(plateau, start_s, position, mistracked, moved, stepped))
    return traces


def _stage_z(recording: Recording, plateau: Plateau) -> tuple[float, float]:
    """Range of the subtracted drift in z within a plateau, and its step since the one before."""
    if recording.drift is None:
        return 0.0, 0.0
    drift = recording.drift.subtracted_nm[:, 2]
    own = drift[plateau.start : plateau.stop]
    known = own[np.isfinite(own)]
    if not len(known):
        return 0.0, 0.0
    step = 0.0
    if plateau.number > 0:
        before = recording.plateaus[plateau.number - 1]
        last = drift[before.start : before.stop]
        last = last[np.isfinite(last)]
        if len(last):
            step = abs(float(np.median(known[:STEP_FRAMES]) - np.median(last[-STEP_FRAMES:])))
    return float(np.ptp(known)), step
