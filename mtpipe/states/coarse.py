"""Where the whole log has to be moved to for every dwell to be one state, roughly.

The log's dwells and moves, shifted, cut the recording into stretches of a mean and a variance each.
The shift of most likelihood is that at which the stretches are purest; a lag longer than a dwell is
found too, as the pattern of all moves has to fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.types import FloatArray
from mtpipe.states.edges import Edge
from mtpipe.states.motion import Motion, independent_share

# Longest lag that is looked for. Nobody's clocks differ by more, and a recording that does not go
# on for several times as long could not tell.
LONGEST_LAG_S = 60.0
LONGEST_SHARE = 0.4
# Steps of the search per shortest dwell; it is refined edge by edge.
STEPS_PER_DWELL = 50
LEAST_ROWS = 4


def likely_shift(motion: Motion, edges: Sequence[Edge]) -> tuple[int, float]:
    """Shift of the log in rows, and by how many nats it is more likely than none.

    The nats are those of all beads but the one that speaks for it most, where there are several.
    """
    rows = len(motion.time_s)
    furthest = int(min(LONGEST_LAG_S / motion.frame_s, LONGEST_SHARE * rows))
    dwells = np.diff([0, *(edge.start for edge in edges), rows])
    step = max(1, int(dwells.min()) // STEPS_PER_DWELL)
    shifts = np.arange(-(furthest // step), furthest // step + 1) * step
    inner = np.unique([row for edge in edges for row in (edge.stop, edge.start)])
    cuts = np.clip(inner + shifts[:, None], 0, rows)
    ends = np.full((len(shifts), 1), rows)
    cuts = np.hstack([np.zeros_like(ends), cuts, ends]).astype(np.int64)
    stretches = _stretches(edges, rows)
    gains = []
    for xyz in motion.position_nm.values():
        total = np.zeros(len(shifts))
        for axis in range(3):
            shares = [independent_share(xyz[a:b, axis]) for a, b in stretches]
            share = float(np.median([s for s in shares if s > 0] or [0.0]))
            if share > 0:
                total -= 0.5 * share * _cost(xyz[:, axis], cuts)
        gains.append(total - total[len(shifts) // 2])
    every = np.sum(gains, axis=0)
    best = int(np.argmax(every))
    each = [gain[best] for gain in gains]
    left = float(every[best]) - (max(each) if len(each) > 1 else 0.0)
    return int(shifts[best]), left


def _stretches(edges: Sequence[Edge], rows: int) -> list[tuple[int, int]]:
    starts = [0, *(edge.start for edge in edges)]
    stops = [*(edge.stop for edge in edges), rows]
    return list(zip(starts, stops, strict=True))


def _cost(column: FloatArray, cuts: NDArray[np.int64]) -> FloatArray:
    """(shifts,) Σ n ln variance over the stretches between cuts (shifts, stretches + 1)."""
    known = np.isfinite(column)
    value = np.where(known, column - np.nanmedian(column), 0.0)
    sums = [
        np.concatenate([[0.0], np.cumsum(each)]) for each in (known.astype(float), value, value**2)
    ]
    count, first, second = (np.diff(one[cuts], axis=1) for one in sums)
    enough = count >= LEAST_ROWS
    n = np.maximum(count, 1.0)
    variance = second / n - (first / n) ** 2
    floor = 1e-9 * float(np.var(value[known])) if known.any() else 1.0
    return np.asarray(
        np.sum(np.where(enough, n * np.log(np.maximum(variance, max(floor, 1e-12))), 0.0), axis=1)
    )
