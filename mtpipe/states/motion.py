"""What tests of states look at: cleaned positions of all tethered beads, and their noise."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from mtpipe.ground.types import FloatArray
from mtpipe.physics.mistracking import without_mistracked
from mtpipe.recording.recording import Recording
from mtpipe.states.blocks import block_means, block_width, relaxation_frames
from mtpipe.states.level import FEWEST_BLOCKS, fit_noise_about_step

# Frames of a stretch's middle from which its noise is estimated; more make it no better.
MOST_FRAMES = 16_384
# The focus is moved within this time, and by this many times what the stage usually does in it.
FOCUS_S, FOCUS_TIMES = 1.5, 4.0
# A column of which more is lost tells nothing of when something happened.
LEAST_KNOWN = 0.5


@dataclass(frozen=True)
class Motion:
    """Positions of the tethered beads, mistracked frames blanked.

    Attributes
    ----------
    time_s : (n_frames,). frame_s : interval of frames.
    position_nm : by bead (n_frames, 3), NaN where lost.
    focus_nm : (n_frames,) how far someone moves the focus about each frame, 0 where nobody does.
        Look-up tables are not alike (PHYSICS 8.8), so that z may change by some of it while the
        force does not.
    subtracted_nm : (n_frames,) height of the references that was subtracted; None without them.
    """

    time_s: FloatArray
    frame_s: float
    position_nm: Mapping[str, FloatArray]
    focus_nm: FloatArray
    subtracted_nm: FloatArray | None

    def rows_s(self, rows: float) -> float:
        """Duration of a number of rows in seconds."""
        return rows * self.frame_s


def motion_of(recording: Recording) -> Motion:
    """The beads' motion; each plateau and the move after it is cleaned by itself."""
    starts = [0, *(plateau.start for plateau in recording.plateaus[1:]), len(recording.time_s)]
    cleaned = {}
    for bead in recording.tethered:
        xyz = recording.positions_nm[bead]
        pieces = [without_mistracked(xyz[a:b])[0] for a, b in itertools.pairwise(starts)]
        cleaned[bead] = np.concatenate(pieces)
    frame_s = float(np.median(np.diff(recording.time_s)))
    focus_nm = focus_moves_nm(recording, frame_s)
    return Motion(recording.time_s, frame_s, cleaned, focus_nm, _height_of_references(recording))


def _height_of_references(recording: Recording) -> FloatArray | None:
    """(n_frames,) z of the references that was subtracted; None where none was."""
    if recording.drift is None or recording.drift.method != "reference":
        return None
    subtracted = recording.drift.subtracted_nm[:, 2]
    known = np.flatnonzero(np.isfinite(subtracted))
    if not len(known):
        return None
    return np.interp(np.arange(len(subtracted)), known, subtracted[known])


def focus_moves_nm(recording: Recording, frame_s: float) -> FloatArray:
    """(n_frames,) range of the subtracted motion in z within FOCUS_S of each frame, where it is far
    beyond the usual.
    """
    stage = _height_of_references(recording)
    if stage is None:
        return np.zeros(len(recording.time_s))
    width = 2 * max(1, round(FOCUS_S / frame_s)) + 1
    moved = ndimage.maximum_filter1d(stage, width) - ndimage.minimum_filter1d(stage, width)
    return np.where(moved > FOCUS_TIMES * float(np.median(moved)), moved, 0.0)


def middle(column: FloatArray) -> FloatArray:
    """The middle MOST_FRAMES of a column."""
    spare = max((len(column) - MOST_FRAMES) // 2, 0)
    return column[spare : len(column) - spare]


def slowest_relaxation(motion: Motion, start: int, stop: int) -> float:
    """Frames within which the beads of a stretch relax sideways: the median of the beads."""
    found = [
        max(relaxation_frames(middle(xyz[start:stop, axis])) for axis in (0, 1))
        for xyz in motion.position_nm.values()
    ]
    return float(np.median(found)) if found else 0.0


def height_relaxation(motion: Motion, start: int, stop: int) -> float:
    """Frames within which the heights of all beads of a stretch relax."""
    found = [relaxation_frames(middle(xyz[start:stop, 2])) for xyz in motion.position_nm.values()]
    return max(found, default=0.0)


def independent_share(column: FloatArray) -> float:
    """Independent values per frame of a stretch of one coordinate, as far as its mean goes.

    White noise has 1, a bead that relaxes within n frames 1/(2n), one that drifts less.
    """
    column = middle(column)
    known = np.isfinite(column)
    if known.sum() < LEAST_KNOWN * len(column) or known.sum() < 4 * FEWEST_BLOCKS:
        return 0.0
    width = block_width(relaxation_frames(column), len(column))
    means = block_means(column[: len(column) // width * width], width)
    variance = float(np.var(column[known]))
    if means is None or len(means) < FEWEST_BLOCKS or variance == 0:
        return 0.0
    noise = fit_noise_about_step(means)
    # the walk counts as far as it goes within a stretch
    slow = noise.white * (1 + noise.walk_share * len(means) / 6)
    return min(1.0, variance / (slow * width)) if slow > 0 else 1.0
