"""Plateaus: the stretches of a recording during which the magnets rest (FORMATS section 1)."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import Plateau
from mtpipe.setup.tables import Plateaus

# Tolerance in frames for times: stamps are rounded, and a frame at the very end of a time is in it.
SLACK_FRAMES = 0.01


def find_plateaus(
    time_s: FloatArray,
    magnet_mm: FloatArray | None,
    choice: Plateaus,
    resting: NDArray[np.bool_] | None = None,
) -> tuple[Plateau, ...]:
    """Cut a recording into plateaus.

    Parameters
    ----------
    time_s : (n_frames,)
    magnet_mm : (n_frames,) or None, then the whole recording is one plateau. NaN is no position.
    choice : shortest plateau, tolerance and settling time (`[plateaus]`).
    resting : (n_frames,) False where something else forbids a plateau (magnets rotating, an
        all-zero start-up block); None: nowhere.

    Returns
    -------
    Plateaus in time order, numbered from 0. With a tolerance, a stretch lasts as long as the
    position stays within the tolerance of where the stretch began, and its `magnet_mm` is the
    median; otherwise it is an unbroken stretch of one value.
    """
    n = len(time_s)
    position = np.zeros(n) if magnet_mm is None else magnet_mm
    allowed = np.isfinite(position) if resting is None else np.isfinite(position) & resting
    frame_s = float(np.median(np.diff(time_s))) if n > 1 else 0.0
    slack_s = SLACK_FRAMES * frame_s
    found: list[Plateau] = []
    for start, stop in _stretches(position, allowed, choice.tolerance_mm):
        begin = start
        if start > 0 and choice.settle_s > 0:
            settled_s = time_s[start] + choice.settle_s - slack_s
            begin = start + int(np.searchsorted(time_s[start:stop], settled_s))
        lasts_s = time_s[stop - 1] - time_s[begin] + frame_s + slack_s if stop > begin else 0.0
        if stop - begin < 2 or lasts_s < choice.minimum_s:
            continue
        value = None if magnet_mm is None else float(np.median(position[begin:stop]))
        found.append(Plateau(len(found), begin, stop, value))
    return tuple(found)


def _stretches(
    position: FloatArray, allowed: NDArray[np.bool_], tolerance_mm: float
) -> list[tuple[int, int]]:
    n = len(position)
    if tolerance_mm == 0:
        change = np.flatnonzero((np.diff(position) != 0) | (allowed[1:] != allowed[:-1])) + 1
        edges = np.concatenate([[0], change, [n]])
        return [(int(a), int(b)) for a, b in itertools.pairwise(edges) if allowed[a]]
    stretches = []
    start = 0
    while start < n:
        if not allowed[start]:
            start += 1
            continue
        stop = _end(position, allowed, start, float(position[start]), tolerance_mm)
        # a stretch that began in the last steps of a move would end at the first noise to the
        # other side: its own median decides where the magnets rest
        while True:
            centre = float(np.median(position[start:stop]))
            start += int(np.argmax(np.abs(position[start:stop] - centre) <= tolerance_mm))
            farther = _end(position, allowed, start, centre, tolerance_mm)
            if farther <= stop:
                break
            stop = farther
        stretches.append((start, stop))
        start = stop
    return stretches


def _end(
    position: FloatArray,
    allowed: NDArray[np.bool_],
    start: int,
    centre_mm: float,
    tolerance_mm: float,
) -> int:
    """First frame after `start` that is not allowed or farther than the tolerance from a centre."""
    block = 4096
    for begin in range(start + 1, len(position), block):
        piece = slice(begin, begin + block)
        away = ~allowed[piece] | (np.abs(position[piece] - centre_mm) > tolerance_mm)
        if away.any():
            return begin + int(np.argmax(away))
    return len(position)
