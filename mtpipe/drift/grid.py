"""A recording's axes as series on the camera's regular grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtpipe.drift.lowpass import coefficients, stretches
from mtpipe.ground.errors import RecordingError
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import Recording

# Longest gap on the grid (s). A longer one, as a pause of hours, is shortened to this to save
# memory: drift is not bridged over it anyway.
LONGEST_GAP_S = 100.0
# Within pieces that serve to estimate noise, interpolated frames must be few.
BRIDGED_FRAMES = 8
SHORTEST_PIECE = 32
MOSTLY_KNOWN = 0.7
WITNESS_KNOWN = 0.9


@dataclass(frozen=True)
class Grid:
    """Where a recording's rows lie on the grid.

    Attributes
    ----------
    rate_hz : frames per second, from the time stamps.
    row : (n_frames,) place of each row on the grid, increasing from 0.
    pieces : ranges [start, stop) on the grid in which the magnets rest; the whole recording where
        it has no plateau.
    """

    rate_hz: float
    row: NDArray[np.int64]
    pieces: tuple[tuple[int, int], ...]

    @property
    def size(self) -> int:
        """Number of places on the grid."""
        return int(self.row[-1]) + 1

    def series_nm(self, recording: Recording, bead: str, axis: int) -> FloatArray:
        """(size,) one axis of one bead, NaN where lost; a copy."""
        values = recording.positions_nm[bead][:, axis]
        if len(values) == self.size:
            return values.copy()
        series = np.full(self.size, np.nan)
        series[self.row] = values
        return series

    def known_pieces(self, known: NDArray[np.bool_]) -> list[tuple[int, int]]:
        """Parts of the plateaus that are known but for a few frames here and there."""
        found = []
        for start, stop in self.pieces:
            for a, b in stretches(known[start:stop], BRIDGED_FRAMES):
                enough = np.mean(known[start + a : start + b]) >= MOSTLY_KNOWN
                if enough and b - a >= SHORTEST_PIECE:
                    found.append((start + a, start + b))
        return found


def grid_of(recording: Recording) -> Grid:
    """The grid of a recording.

    Raises
    ------
    RecordingError : fewer than two frames, or time standing still.
    """
    frame, time = recording.frame, recording.time_s
    if len(frame) < 2 or not time[-1] > time[0]:
        raise RecordingError(
            "has fewer than two frames, or its time does not advance", where=recording.name
        )
    rate_hz = float((frame[-1] - frame[0]) / (time[-1] - time[0]))
    steps = np.minimum(np.diff(frame), max(1, round(LONGEST_GAP_S * rate_hz)))
    row = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(steps)])
    pieces = tuple((int(row[p.start]), int(row[p.stop - 1]) + 1) for p in recording.plateaus)
    return Grid(rate_hz, row, pieces or ((0, int(row[-1]) + 1),))


def piece_coefficients(
    series_nm: FloatArray, pieces: list[tuple[int, int]], known: NDArray[np.bool_]
) -> list[FloatArray]:
    """Cosine coefficients of a series in each piece, from the frames that are `known`.

    NaN where the series itself is lost in more than a tenth of them.
    """
    result = []
    for start, stop in pieces:
        piece = np.where(known[start:stop], series_nm[start:stop], np.nan)
        if np.sum(np.isfinite(piece)) < WITNESS_KNOWN * np.sum(known[start:stop]):
            result.append(np.full(stop - start, np.nan))
        else:
            result.append(coefficients(piece))
    return result
