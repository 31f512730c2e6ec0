"""Faults of a reference bead in time: frames the tracker got wrong, and jumps of the bead.

Both are told from motion of the stage by witnesses, series that share the stage: the other
reference beads, or the tethered beads where there is only one. Running medians leave steps as
steps, so a stage that is moved is no mistracking.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, median_filter

from mtpipe.ground.types import FloatArray

# An excursion shorter than half a window stands out from the running median. The short window
# finds spikes amid drift, the long one episodes of mistracking that last seconds.
WINDOWS_S = (0.5, 10.0)
SPIKE_SIGMA = 10.0
BLOCK_S = 0.5
JUMP_SIGMA = 8.0
JUMP_NOISES = 5.0
WITNESS_SIGMA = 4.0
NORMAL_MAD = 1.4826


@dataclass(frozen=True)
class Jumps:
    """Jumps of a bead that its witnesses do not share.

    `first` is where the first is, in frames of the grid; `largest_nm` is the size of the largest,
    `total_nm2` the sum of all squared.
    """

    number: int
    first: int
    largest_nm: float
    total_nm2: float


NO_JUMPS = Jumps(0, 0, 0.0, 0.0)


def mistracked(
    series_nm: FloatArray, witnesses_nm: Sequence[FloatArray], rate_hz: float
) -> NDArray[np.bool_]:
    """Frames in which a bead leaves its place and comes back, and the witnesses do not.

    Parameters
    ----------
    series_nm : (n,) NaN where lost.
    witnesses_nm : each (n,).

    Returns
    -------
    (n,) True where mistracked: more than ten times the local spread (median absolute deviation)
    from the running median, unless half of the witnesses make at least half of the excursion.
    """
    wrong = np.zeros(len(series_nm), dtype=bool)
    for window_s in WINDOWS_S:
        width = 2 * round(window_s * rate_hz / 2) + 1
        known = np.flatnonzero(np.isfinite(series_nm) & ~wrong)
        # the wider window has to reach no farther than the series mirrored once
        if width < 5 or len(known) <= 2 * width:
            continue
        away = _excursion(series_nm[known], width)
        spread = NORMAL_MAD * median_filter(np.abs(away), 4 * width + 1, mode="mirror")
        # Rounding can make the spread zero: no less than half of the usual one or a usual step.
        spread = np.maximum(spread, max(np.median(spread), _usual_step(series_nm[known])) / 2)
        far = np.abs(away) > SPIKE_SIGMA * spread
        if not far.any():
            continue
        if witnesses_nm:
            shared = [
                np.abs(_excursion(held(w[known]), width)[far] - away[far]) < np.abs(away[far]) / 2
                for w in witnesses_nm
            ]
            far[far] = np.mean(shared, axis=0) < 0.5
        wrong[known[far]] = True
    # The frames beside a mistracked one were tracked from a wrong guess.
    return np.asarray(binary_dilation(wrong)) & np.isfinite(series_nm)


def jumps_among(
    series_nm: FloatArray,
    others_nm: Sequence[FloatArray],
    pieces: Sequence[tuple[int, int]],
    rate_hz: float,
    noise_nm: float,
) -> Jumps:
    """Jumps of a reference against other references.

    A jump is a change between medians of half a second that stands out from the usual changes
    against the others' median by eight times their spread, exceeds five times the noise of a
    frame, and is larger than the others' own.

    Parameters
    ----------
    series_nm : (n,); others_nm: each (n,).
    pieces : ranges [start, stop) to look at, one per plateau.
    noise_nm : white noise of the reference per frame.
    """
    size = max(1, round(BLOCK_S * rate_hz))
    rows, own = _steps(series_nm, pieces, size)
    if not len(own):
        return NO_JUMPS
    shared = np.median([_steps(o, pieces, size)[1] for o in others_nm], axis=0)
    against = own - shared
    spread = NORMAL_MAD * float(np.nanmedian(np.abs(against)))
    found = (np.abs(against) > max(JUMP_SIGMA * spread, JUMP_NOISES * noise_nm)) & (
        np.abs(own) > np.abs(shared)
    )
    return _summary(rows, size, against, found)


def jumps_alone(
    series_nm: FloatArray,
    tethered_nm: Sequence[FloatArray],
    pieces: Sequence[tuple[int, int]],
    rate_hz: float,
    noise_nm: float,
) -> Jumps:
    """Jumps of a lone reference that the tethered beads, within their fluctuation, do not make.

    Parameters as in `jumps_among`. A step that the tethered beads fluctuate too much to confirm or
    deny counts as the stage's.
    """
    size = max(1, round(BLOCK_S * rate_hz))
    rows, own = _steps(series_nm, pieces, size)
    if not len(own) or not tethered_nm:
        return NO_JUMPS
    total, weight = np.zeros(len(own)), np.zeros(len(own))
    for series in tethered_nm:
        at = 0
        for piece in pieces:
            step = _steps(series, [piece], size)[1]
            here = slice(at, at + len(step))
            at += len(step)
            spread = NORMAL_MAD * float(np.nanmedian(np.abs(step))) if len(step) > 8 else math.nan
            if not spread > 0:
                continue
            usable = np.isfinite(step)
            total[here][usable] += step[usable] / spread**2
            weight[here][usable] += 1 / spread**2
    known = weight > 0
    witness = np.where(known, total / np.where(known, weight, 1.0), np.nan)
    error = np.where(known, 1 / np.sqrt(np.where(known, weight, 1.0)), np.inf)
    usual = NORMAL_MAD * float(np.nanmedian(np.abs(own)))
    found = (
        (np.abs(own) > max(JUMP_SIGMA * usual, JUMP_NOISES * noise_nm))
        & (np.abs(witness) < np.abs(own) / 2)
        & (np.abs(own - witness) > WITNESS_SIGMA * error)
    )
    return _summary(rows, size, own, found)


def _excursion(series: FloatArray, width: int) -> FloatArray:
    return np.asarray(series - median_filter(series, width, mode="mirror"))


def _usual_step(series: FloatArray) -> float:
    steps = np.abs(np.diff(series))
    moving = steps[steps > 0]
    return float(np.median(moving)) if len(moving) else 0.0


def held(series: FloatArray) -> FloatArray:
    """The series with lost frames holding the last known position."""
    known = np.isfinite(series)
    if known.all() or not known.any():
        return np.nan_to_num(series)
    last = np.maximum.accumulate(np.where(known, np.arange(len(series)), 0))
    return np.nan_to_num(series[last], nan=float(series[known][0]))


def _steps(
    series: FloatArray, pieces: Sequence[tuple[int, int]], size: int
) -> tuple[NDArray[np.int64], FloatArray]:
    """Rows, and change of the block median from the block before to the block after."""
    rows, steps = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for start, stop in pieces:
        n = (stop - start) // size
        if n < 3:
            continue
        blocks = held(series[start : start + n * size]).reshape(n, size)
        middle = np.median(blocks, axis=1)
        steps.append(middle[2:] - middle[:-2])
        rows.append(start + size * np.arange(1, n - 1, dtype=np.int64))
    return np.concatenate(rows), np.concatenate(steps)


def _summary(
    rows: NDArray[np.int64], size: int, step_nm: FloatArray, found: NDArray[np.bool_]
) -> Jumps:
    at = np.flatnonzero(found)
    if not len(at):
        return NO_JUMPS
    # One jump shows in neighbouring blocks: it lies in their middle, and the largest is its size.
    begin = np.concatenate([[0], np.flatnonzero(np.diff(at) > 2) + 1])
    sizes = np.maximum.reduceat(np.abs(step_nm[at]), begin)
    last = at[begin[1] - 1] if len(begin) > 1 else at[-1]
    first = int(rows[at[0]] + rows[last] + size) // 2
    return Jumps(len(sizes), first, float(sizes.max()), float(np.sum(sizes**2)))
