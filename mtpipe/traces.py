"""Traces: one bead in one plateau, on the camera's grid, mistracked frames blanked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtpipe.mistracking import without_mistracked
from mtpipe.physics.camera import FloatArray
from mtpipe.recording import Plateau, Recording


@dataclass(frozen=True)
class Trace:
    """One bead in one plateau, cleaned: (n_frames, 3) nm on the camera's grid, NaN where lost.

    `stage_z_nm` is how far the drift that was subtracted moved in z during the plateau.
    """

    plateau: Plateau
    start_s: float
    position_nm: FloatArray
    mistracked: int
    stage_z_nm: float

    @property
    def recorded(self) -> tuple[bool, bool, bool]:
        """Per axis, whether there is any position at all."""
        seen = np.isfinite(self.position_nm)
        return (bool(seen[:, 0].any()), bool(seen[:, 1].any()), bool(seen[:, 2].any()))

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
        traces.append(Trace(plateau, start_s, position, mistracked, _stage_z(recording, plateau)))
    return traces


def _stage_z(recording: Recording, plateau: Plateau) -> float:
    if recording.drift is None:
        return 0.0
    z = recording.drift.subtracted_nm[plateau.start : plateau.stop, 2]
    known = z[np.isfinite(z)]
    return float(np.ptp(known)) if len(known) else 0.0
