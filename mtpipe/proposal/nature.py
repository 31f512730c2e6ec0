"""What a column of numbers is by its values alone: a clock, a count, a motor, something that moves.

For files that name no columns, and as a check on the names of those that do.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from mtpipe.ground.types import FloatArray

Nature = Literal["dead", "constant", "count", "clock", "motor", "motion"]
# A whole number means lost if it stands in at least 3 rows, and is 3 times as far from all other
# values as these are from one another.
LOST_ROWS = 3
LOST_SPANS = 3.0
# A count goes on by one from nearly every row to the next; cameras lose frames.
COUNTED_SHARE = 0.9
# A motor's set value repeats exactly, a tracker's positions hardly ever.
REPEATED_SHARE = 0.5
# A motor that reads back with noise rests between moves: nearly all windows of this many rows are
# narrow against the whole range, which is made by few of them.
WINDOW_ROWS = 50
FEWEST_WINDOWS = 20
NARROW = 0.02
RESTING_SHARE = 0.6
MOVING_SHARE = 0.8


def nature_of(values: FloatArray) -> Nature:
    """What a column is by its values (n,), NaN where there is none."""
    marks = lost_marks(values)
    known = values[np.isfinite(values) & ~np.isin(values, marks)]
    if len(known) < 2:
        return "dead"
    if known.min() == known.max():
        return "dead" if known[0] == 0 or len(known) < len(values) / 2 else "constant"
    steps = np.diff(known)
    if _is_climbing(known):
        whole = bool(np.all(known == np.rint(known)))
        counted = whole and float(np.mean(steps == 1)) > COUNTED_SHARE
        return "count" if counted else "clock"
    if float(np.mean(steps == 0)) > REPEATED_SHARE or _rests_and_moves(known):
        return "motor"
    return "motion"


def lost_marks(values: FloatArray) -> list[float]:
    """Whole numbers that mean lost: in several rows, and far from all the others."""
    known = values[np.isfinite(values)]
    marks: list[float] = []
    if len(known) < 2 * LOST_ROWS:
        return marks
    for value in {float(known.min()), float(known.max())}:
        others = known[known != value]
        repeated = LOST_ROWS <= len(known) - len(others) < len(known) / 2
        far = len(others) > 0 and np.min(np.abs(others - value)) > LOST_SPANS * np.ptp(others)
        if repeated and far and value == round(value):
            marks.append(value)
    return marks


def _is_climbing(known: FloatArray) -> bool:
    """Whether values go up all the time at a steady pace, as clocks do."""
    steps = np.diff(known)
    if len(steps) < 2 or not np.all(steps >= 0):
        return False
    # coarse stamps repeat, but over many rows the pace is steady
    line = np.linspace(known[0], known[-1], len(known))
    return bool(np.max(np.abs(known - line)) < 0.5 * (known[-1] - known[0]))


def _rests_and_moves(known: FloatArray) -> bool:
    windows = len(known) // WINDOW_ROWS
    if windows < FEWEST_WINDOWS:
        return False
    pieces = known[: windows * WINDOW_ROWS].reshape(windows, WINDOW_ROWS)
    spans = pieces.max(axis=1) - pieces.min(axis=1)
    narrow = spans < NARROW * (known.max() - known.min())
    made_by_moves = spans[~narrow].sum() > MOVING_SHARE * (known.max() - known.min())
    return bool(narrow.mean() > RESTING_SHARE and narrow.mean() < 1 and made_by_moves)
