"""A stretch of a bead's trace as block means: height, and how much it moves sideways."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from mtpipe.ground.types import FloatArray

# Relaxation times per block: means of blocks this long are nearly independent of one another.
RELAXATIONS_PER_BLOCK = 4.0
# More blocks place a step no better: it is placed frame by frame afterwards.
MOST_BLOCKS = 400
# Blocks at least, however slow a bead is: with fewer no noise can be told from a step.
LEAST_BLOCKS = 24
# Blocks over which sideways motion counts as drift and no longer as thermal motion.
SLOW_BLOCKS = 8


@dataclass(frozen=True)
class Blocks:
    """Block means of a stretch: height in nm, and sideways motion, whose blocks may be wider.

    `motion` is the cube root (Wilson and Hilferty 1931: nearly normal) of the mean square of x and
    y about where they slowly are, over that of the whole stretch. None without positions.
    """

    height_nm: FloatArray | None
    motion: FloatArray | None


def blocks_of(position_nm: FloatArray, width: int, lateral: int | None = None) -> Blocks:
    """Block means of a stretch, (n_frames, 3) nm with NaN where lost; blocks of `width` frames,
    those of sideways motion of `lateral` frames where that is given.

    What is left over at the end belongs to no block. Blocks without a position are interpolated.
    """
    height = block_means(position_nm[: len(position_nm) // width * width, 2], width)
    width = width if lateral is None else lateral
    count = len(position_nm) // width
    squares = []
    for column in position_nm[: count * width, :2].T:
        known = np.isfinite(column)
        if known.sum() < 2 * count:
            continue
        filled = np.interp(np.arange(len(column)), np.flatnonzero(known), column[known])
        slow = ndimage.uniform_filter1d(filled, min(SLOW_BLOCKS * width, len(filled)))
        square = np.where(known, (filled - slow) ** 2, np.nan)
        mean = float(np.nanmean(square))
        if mean > 0:
            squares.append(square / mean)
    motion = block_means(np.mean(squares, axis=0), width) if squares else None
    return Blocks(height, None if motion is None else np.cbrt(motion))


def block_means(column: FloatArray, width: int) -> FloatArray | None:
    """Means of blocks of a column (a multiple of `width` long), gaps interpolated; None where more
    than half of the blocks are lost.
    """
    blocks = column.reshape(-1, width)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        means = np.nanmean(blocks, axis=1)
    known = np.flatnonzero(np.isfinite(means))
    if 2 * len(known) < len(means) or len(known) < 2:
        return None
    return np.asarray(np.interp(np.arange(len(means)), known, means[known]))


def block_width(relaxation_frames: float, frames: int) -> int:
    """Frames per block, given the relaxation time of the slowest bead in frames."""
    wanted = max(RELAXATIONS_PER_BLOCK * relaxation_frames, frames / MOST_BLOCKS, 1.0)
    return max(1, int(min(wanted, frames / LEAST_BLOCKS)))


def relaxation_frames(column: FloatArray) -> float:
    """Frames after which the correlation of a position, (n,) with NaN, has fallen to 1/e of that of
    neighbouring frames; 0 where neighbours are uncorrelated.
    """
    known = np.isfinite(column)
    if known.sum() < 16:
        return 0.0
    index = np.arange(len(column))
    filled = np.interp(index, index[known], column[known])
    filled = filled - np.polyval(np.polyfit(index, filled, 1), index)
    power = np.abs(fft.rfft(filled, 2 * len(filled))) ** 2
    correlation = fft.irfft(power)[: len(filled)] / np.arange(len(filled), 0, -1)
    if not correlation[1] > correlation[0] / np.sqrt(len(filled)) * 3:
        return 0.0
    below = np.flatnonzero(correlation[1:] < correlation[1] / np.e)
    return float(below[0]) if len(below) else len(filled) / 2
