"""When the magnets rest: tolerance, shortest plateau and settling time of `[plateaus]`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.setup.tables import Plateaus

# Quiet stretches to take a motor's noise from; moves are the few wide ones.
QUIET = 0.5
NOISE_MARGIN = 3.0
NOISE_SHARE = 0.1  # of the range of positions; more is no noise of a motor at rest
WINDOW_S, WINDOW_ROWS = 0.3, 5
# A log has few entries per second, and a stretch has to hold several of them to show their scatter.
LONGEST_WINDOW_S = 2.0
# Of the usual step from frame to frame; time stamps that are rounded bend a line by less.
STRAIGHT = 0.1
SHORTEST_S = 0.5
# Of the dwells that hold most of the recording, a plateau takes those that are no shorter than
# this part of the usual one.
USUAL_SHARE = 0.5
# Settling time (s) with a log: it is written some times per second, positions between two entries
# are interpolated, and logs are early or late by up to half a second: a clock that was found by the
# beads is known no better, and one that is said to be the camera's may lag.
LOG_SETTLE_S = 1.0
HALF_THE_TIME = 0.5


@dataclass(frozen=True)
class Rest:
    """Choices of `[plateaus]` that are not the default's, and why."""

    choices: dict[str, float]
    why: dict[str, str]


def rest_of(time_s: FloatArray, magnet_mm: FloatArray, *, log: bool) -> Rest:
    """Choose what counts as a plateau.

    Parameters
    ----------
    time_s, magnet_mm : (n_frames,), NaN where the magnets' place is not known.
    log : whether positions come from a log of their own.
    """
    choices: dict[str, float] = {}
    why: dict[str, str] = {}
    noise = _noise_mm(time_s, magnet_mm)
    if 0 < noise < NOISE_SHARE * float(np.ptp(magnet_mm[np.isfinite(magnet_mm)])):
        choices["tolerance_mm"] = _rounded_up(NOISE_MARGIN * noise)
        why["tolerance_mm"] = f"the magnets' position scatters by {noise:.2g} mm while they rest"
    if log:
        choices["settle_s"] = LOG_SETTLE_S
        why["settle_s"] = "the log may be early or late by half a second"
    default = Plateaus()
    every = find_plateaus(time_s, magnet_mm, Plateaus(minimum_s=SHORTEST_S, **choices))
    lasts = np.array([time_s[p.stop - 1] - time_s[p.start] for p in every])
    if len(lasts) and lasts[lasts >= default.minimum_s].sum() < HALF_THE_TIME * lasts.sum():
        # the dwell in which half of the resting time is spent
        order = np.sort(lasts)
        usual = float(order[np.searchsorted(np.cumsum(order), order.sum() / 2)])
        choices["minimum_s"] = float(f"{max(USUAL_SHARE * usual, SHORTEST_S):.2g}")
        why["minimum_s"] = f"the magnets' usual rest is {usual:.2g} s"
    return Rest(choices, why)


def _noise_mm(time_s: FloatArray, magnet_mm: FloatArray) -> float:
    """Peak-to-peak scatter of the position in the quieter half of short stretches."""
    frame_s = float(np.median(np.diff(time_s)))
    width = max(WINDOW_ROWS, round(WINDOW_S / frame_s))
    entries = WINDOW_ROWS * _frames_per_entry(magnet_mm)
    if entries * frame_s <= LONGEST_WINDOW_S:
        width = max(width, round(entries))
    count = len(magnet_mm) // width
    if count == 0:
        return 0.0
    pieces = magnet_mm[: count * width].reshape(count, width)
    pieces = pieces[np.isfinite(pieces).all(axis=1)]
    if len(pieces) == 0:
        return 0.0
    spans = np.sort(pieces.max(axis=1) - pieces.min(axis=1))
    quiet = spans[: max(1, math.ceil(QUIET * len(spans)))]
    return float(np.max(quiet))


def _frames_per_entry(magnet_mm: FloatArray) -> float:
    """How many frames a log's entry stands for: positions between two entries lie on a line.

    An entry bends the line at one frame, or at two if it lies between them.
    """
    steps = np.abs(np.diff(magnet_mm))
    moving = steps[steps > 0]
    if len(moving) == 0:
        return float(len(magnet_mm))
    bends = np.abs(np.diff(magnet_mm, 2)) > STRAIGHT * np.median(moving)
    alone = float(np.count_nonzero(bends[1:] & ~bends[:-1]))
    return len(magnet_mm) / max(alone, float(np.count_nonzero(bends)) / 2, 1.0)


def _rounded_up(value: float) -> float:
    """The next number of one digit, so that a key is easy to read."""
    size = 10.0 ** math.floor(math.log10(value))
    return float(f"{math.ceil(value / size) * size:.1g}")
