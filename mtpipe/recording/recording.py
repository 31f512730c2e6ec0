"""A recording: positions of all beads frame by frame, and its plateaus of constant force.

The same type holds a laboratory's recording, one after drift subtraction, and a simulated one.
Positions are in nm, times in s. A frame that is absent from the file is absent here too: `frame`
numbers count on the camera's own regular grid, so gaps show as jumps in it, and lost beads as NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ground.shown import Shown
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import number
from mtpipe.setup.setup import Setup

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Plateau:
    """A stretch of rows [start, stop) during which the magnets rest.

    `magnet_mm` is None when the recording has no magnet position (then it is one plateau).
    """

    number: int
    start: int
    stop: int
    magnet_mm: float | None

    def __repr__(self) -> str:
        magnets = "" if self.magnet_mm is None else f", magnets at {self.magnet_mm:.4g} mm"
        return f"Plateau {self.number}: rows {self.start} to {self.stop - 1}{magnets}"


@dataclass(frozen=True)
class ReferenceUse:
    """What became of one reference bead.

    `weight` (x, y, z) sums to one over the beads used; 0 for a bead left out, whose `reason` says
    why. `noise_nm` (x, y, z) is the white tracking noise per frame estimated from the data. `loose`
    says that it moves on its own beside that.
    """

    bead: str
    used: bool
    weight: tuple[float, float, float]
    noise_nm: tuple[float, float, float]
    reason: str = ""
    loose: bool = False


@dataclass(frozen=True)
class StageCourse:
    """Motion of the stage along z that stays in the traces of all beads.

    A random walk, given by its standard deviation after one second (it grows with the root of
    time) with the standard error of that, and a steady motion whose rate is about 0 within
    `steady_nm_per_s`.
    """

    random_nm_per_root_s: float
    random_stderr_nm_per_root_s: float
    steady_nm_per_s: float


@dataclass(frozen=True)
class Drift:
    """What drift subtraction did.

    Attributes
    ----------
    method : as in the setup's `[drift]` table.
    cutoff_hz : low-pass (or high-pass) frequency per axis; None where frame by frame.
    references : every reference bead of the recording, used or left out.
    subtracted_nm : (n_frames, 3) the motion that was subtracted, starting at 0.
    drift_rms_nm : root mean square, per axis, of what was subtracted.
    noise_added_nm : root mean square, per axis, of the references' tracking noise that the
        subtraction carried into every trace.
    start_stderr_nm : standard error, per axis, of where what was subtracted starts: positions keep
        their origin no better.
    beyond_nm : (n_frames,) of beads whose z shows the stage's fast motion on a scale of its own:
        what was subtracted from z beyond `subtracted_nm`.
    left_along_z : the stage's motion along z where no reference bead took it off; None where one
        did, or nothing tells.
    """

    method: Literal["reference", "highpass", "none"]
    cutoff_hz: tuple[float | None, float | None, float | None]
    references: tuple[ReferenceUse, ...]
    subtracted_nm: FloatArray
    drift_rms_nm: tuple[float, float, float]
    noise_added_nm: tuple[float, float, float]
    start_stderr_nm: tuple[float, float, float]
    beyond_nm: Mapping[str, FloatArray] = field(default_factory=dict)
    left_along_z: StageCourse | None = None

    def of_bead(self, bead: str) -> FloatArray:
        """(n_frames, 3) nm, all that was subtracted from one bead."""
        if bead not in self.beyond_nm:
            return self.subtracted_nm
        x, y, z = self.subtracted_nm.T
        return np.column_stack([x, y, z + self.beyond_nm[bead]])


@dataclass(frozen=True)
class SourceFile:
    """One file the recording was read from."""

    name: str
    sha256: str
    bytes: int


@dataclass(frozen=True)
class Tracked:
    """What is known of a recording that mtpipe itself tracked in images.

    `precision_nm` (x, y, z per bead) is the tracking noise per frame that photons and camera make;
    nan where it is not known. Beads in `table_height` have as z the height in a look-up table,
    whose zero is not the surface's until the setup says where that is.
    """

    precision_nm: Mapping[str, tuple[float, float, float]]
    table_height: frozenset[str]


@dataclass(frozen=True)
class States:
    """What testing every plateau for being one state found.

    Attributes
    ----------
    refused : why a bead has no force in a plateau, by bead and plateau number, in words that
        continue "no force, as …".
    doubtful : the same of plateaus that seem to hold several states and are left whole, as a
        cross-check can say what changes in them: their forces are none to use until it does.
    unbelieved : numbers of plateaus whose `magnet_mm` is not to be believed: the beads change under
        it where the log does not.
    """

    refused: Mapping[tuple[str, int], str] = field(default_factory=dict)
    doubtful: Mapping[tuple[str, int], str] = field(default_factory=dict)
    unbelieved: frozenset[int] = frozenset()


@dataclass(frozen=True, repr=False)
class Recording(Shown):
    """Tracked positions with setup and plateaus.

    Attributes
    ----------
    name : file name, or name of the series of files.
    setup : the setup as read.
    time_s : (n_frames,) start of each frame.
    frame : (n_frames,) int64, number of each frame on the camera's regular grid, increasing;
        a jump by more than one is a camera gap.
    positions_nm : for each bead, (n_frames, 3) float64; NaN where the tracker lost the bead, whole
        columns of NaN where an axis was not recorded.
    magnet_mm, magnet_turns : (n_frames,) or None; how far up the magnets are, and how far turned.
    plateaus : in time order.
    z_zero_stderr_nm : standard error of each bead's z = 0, where it was estimated; infinite where
        z has another zero than the surface. Beads that are not named have their extension as z.
    drift : None for a recording as read; else what was subtracted (`mtpipe.subtract_drift`).
    tracked : of a recording that `mtpipe track` wrote; None for any other.
    states : what testing the plateaus found; None where they have not been tested yet.
    """

    name: str
    setup: Setup
    time_s: FloatArray
    frame: NDArray[np.int64]
    positions_nm: Mapping[str, FloatArray]
    magnet_mm: FloatArray | None
    plateaus: tuple[Plateau, ...]
    notices: tuple[Notice, ...] = ()
    files: tuple[SourceFile, ...] = ()
    drift: Drift | None = None
    z_zero_stderr_nm: Mapping[str, float] = field(default_factory=dict)
    tracked: Tracked | None = None
    states: States | None = None
    magnet_turns: FloatArray | None = None

    def __post_init__(self) -> None:
        n = len(self.time_s)
        for bead, xyz in self.positions_nm.items():
            if xyz.shape != (n, 3):
                raise RecordingError(f"bead {bead} has shape {xyz.shape}, expected ({n}, 3)")

    def __repr__(self) -> str:
        lasts_s = float(self.time_s[-1] - self.time_s[0]) if len(self.time_s) else 0.0
        drift = "drift as recorded" if self.drift is None else f"drift: {self.drift.method}"
        return (
            f"Recording {self.name}: {len(self.tethered)} tethered and {len(self.references)} "
            f"reference beads, {len(self.time_s)} frames in {number(lasts_s)} s, "
            f"{len(self.plateaus)} plateaus, {drift}"
        )

    @property
    def table(self) -> pd.DataFrame:
        """A row for each plateau: number, magnet position (mm), start and duration (s), frames."""
        starts = [float(self.time_s[one.start]) for one in self.plateaus]
        ends = [float(self.time_s[one.stop - 1]) for one in self.plateaus]
        return pd.DataFrame(
            {
                "plateau": [one.number for one in self.plateaus],
                "magnet_mm": [one.magnet_mm for one in self.plateaus],
                "start_s": starts,
                "duration_s": [end - start for start, end in zip(starts, ends, strict=True)],
                "frames": [one.stop - one.start for one in self.plateaus],
            }
        )

    @property
    def references(self) -> tuple[str, ...]:
        """Names of the beads fixed to the surface, as far as they are in the recording."""
        return tuple(b for b in self.positions_nm if b in self.setup.beads.reference)

    @property
    def tethered(self) -> tuple[str, ...]:
        """Names of the tethered beads: all that are no reference."""
        return tuple(b for b in self.positions_nm if b not in self.setup.beads.reference)

    def trace_nm(self, bead: str, plateau: Plateau) -> FloatArray:
        """Positions of a bead in a plateau on the camera's regular grid.

        Returns
        -------
        (n_grid, 3) float64, nm. Frames missing from the file are rows of NaN.
        """
        rows = slice(plateau.start, plateau.stop)
        frame = self.frame[rows] - self.frame[plateau.start]
        grid = np.full((int(frame[-1]) + 1, 3), np.nan)
        grid[frame] = self.positions_nm[bead][rows]
        return grid
