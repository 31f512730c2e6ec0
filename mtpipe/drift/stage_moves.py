"""Sudden moves of the stage, as of the focus, which a low-pass would smear over a second.

A running median leaves a step a step. Where it changes within a few frames by far more than it
usually does about that time, and stays there, its course is taken off the reference before the
low-pass and given back behind it.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation, find_objects, label, median_filter

from mtpipe.drift.faults import JUMP_NOISES, JUMP_SIGMA, NORMAL_MAD, held
from mtpipe.ground.types import FloatArray

# Width of the running median, in s and in frames at least: shorter than any drift, long enough for
# its noise to be half of a frame's.
MEDIAN_S, LEAST_FRAMES = 0.05, 5
# Time that counts as "about that time": a stage is louder while someone works at the microscope.
LOCAL_S = 5.0
# Size of a move in nm: half of it, which a low-pass leaves for a second, is less than a tethered
# bead itself moves.
LEAST_NM = 20.0
# What lasts longer a low-pass follows.
LONGEST_S = 3.0


def stage_moves_nm(series_nm: FloatArray, rate_hz: float) -> FloatArray:
    """(n,) position that sudden moves have led to, from 0 at the beginning; 0 where there is none.

    A move is a change between neighbouring medians that stands out from the usual changes about it
    by eight times their spread (median absolute deviation), exceeds five times the noise of a
    single frame and `LEAST_NM`, and leads somewhere else by as much.

    Parameters
    ----------
    series_nm : (n,) the combined reference on the camera's grid, NaN where lost.
    """
    steps = np.zeros(len(series_nm))
    width = 2 * (max(LEAST_FRAMES, round(MEDIAN_S * rate_hz)) // 2) + 1
    if np.isfinite(series_nm).sum() <= 4 * width:
        return steps
    level = median_filter(held(series_nm), width, mode="nearest")
    change = np.zeros(len(level))
    change[width:] = level[width:] - level[:-width]
    frame = NORMAL_MAD * float(np.nanmedian(np.abs(np.diff(series_nm)))) / np.sqrt(2)
    least = np.maximum(
        JUMP_SIGMA * _usual(change, max(1, round(LOCAL_S * rate_hz))),
        max(JUMP_NOISES * frame, LEAST_NM),
    )
    # a change is that within `width` frames before a row
    regions = binary_dilation(np.abs(change) > least, iterations=width)
    for (rows,) in find_objects(label(regions)[0]):
        if rows.stop - rows.start > LONGEST_S * rate_hz:
            continue
        course = level[max(rows.start - 1, 0) : rows.stop]
        if abs(course[-1] - course[0]) > least[rows].min():
            steps[rows] = np.diff(course, prepend=course[:1])[-(rows.stop - rows.start) :]
    return np.cumsum(steps)


def _usual(change: FloatArray, size: int) -> FloatArray:
    """(n,) spread of changes in blocks of a size, each about its own rows."""
    edges = np.arange(0, max(len(change) - size // 2, 1), size)
    blocks = np.split(change, edges[1:])
    spread = [NORMAL_MAD * float(np.median(np.abs(one))) for one in blocks]
    return np.repeat(spread, [len(one) for one in blocks])
