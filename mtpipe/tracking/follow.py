"""Regions that follow their beads, whole pixels at a time.

A bead wanders with the stage and with its height. After each block of frames its region is put
about where it was last; a bead that is lost at the end of a block, as after a jump of the stage,
is looked for in the eight regions around.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.types import FloatArray
from mtpipe.tracking.find_beads import Region

LAST_FRAMES = 32  # a region follows where its bead was in this many frames
SEARCH_FRAMES = 4


def corner(region: Region, shape: tuple[int, int]) -> tuple[int, int]:
    """Row and column of a region's first pixel, moved so that it lies within the image.

    Parameters
    ----------
    shape : height and width of the image, at least the region's size.
    """
    half = (region.size_px - 1) / 2
    row = min(max(round(region.y_px - half), 0), shape[0] - region.size_px)
    column = min(max(round(region.x_px - half), 0), shape[1] - region.size_px)
    return row, column


def cut(frames: NDArray[np.generic], region: Region) -> NDArray[np.generic]:
    """The region's images, (n, size, size), as an array of their own."""
    row, column = corner(region, (frames.shape[1], frames.shape[2]))
    size = region.size_px
    return frames[:, row : row + size, column : column + size].copy()


def followed(region: Region, x_px: FloatArray, y_px: FloatArray) -> Region:
    """The region about where its bead was last: (n,) positions in the image, NaN where lost."""
    seen = np.isfinite(x_px[-LAST_FRAMES:]) & np.isfinite(y_px[-LAST_FRAMES:])
    if not seen.any():
        return region
    x, y = (float(np.median(p[-LAST_FRAMES:][seen])) for p in (x_px, y_px))
    return replace(region, x_px=x, y_px=y)


def is_lost(x_px: FloatArray) -> bool:
    """Whether a bead was in none of the last frames of a block."""
    return not np.isfinite(x_px[-SEARCH_FRAMES:]).any()


def sought(
    region: Region,
    frames: NDArray[np.generic],
    others: Sequence[Region],
    locate: Callable[[NDArray[np.generic]], tuple[FloatArray, FloatArray]],
) -> Region:
    """Where a lost bead is now, if it is in one of the regions around; else where it was.

    Parameters
    ----------
    frames : (n, height, width), of which the last are searched.
    others : regions of the other beads, whose places are taken.
    locate : x and y of a bead in images of a region, in its own pixels; NaN where there is none.
    """
    last = frames[-SEARCH_FRAMES:]
    for candidate in _around(region, (frames.shape[1], frames.shape[2])):
        x, y = locate(cut(last, candidate))
        if not (np.isfinite(x) & np.isfinite(y)).all():
            continue
        row, column = corner(candidate, (frames.shape[1], frames.shape[2]))
        place = (column + float(np.median(x)), row + float(np.median(y)))
        if all(_distance(place, o) > max(o.size_px, region.size_px) / 2 for o in others):
            return replace(region, x_px=place[0], y_px=place[1])
    return region


def _around(region: Region, shape: tuple[int, int]) -> Iterator[Region]:
    """The neighbours of a region within the image, half a region apart, the nearest first."""
    step = region.size_px / 2
    moves = itertools.product((-step, 0.0, step), repeat=2)
    for dx, dy in sorted(moves, key=lambda move: math.hypot(*move)):
        x, y = region.x_px + dx, region.y_px + dy
        if 0 <= x < shape[1] and 0 <= y < shape[0]:
            yield replace(region, x_px=x, y_px=y)


def _distance(place: tuple[float, float], region: Region) -> float:
    return math.hypot(place[0] - region.x_px, place[1] - region.y_px)
