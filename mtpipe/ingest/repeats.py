"""Frames that a program wrote twice: positions that repeat earlier ones to the last digit.

A buffer that is written again before it is filled repeats whole blocks; a camera that stalls
repeats its last frame. Brownian motion never comes back to the same positions several frames in a
row, so a block that repeats an earlier one is no chance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.notice import Notice
from mtpipe.ground.types import FloatArray

# Least length of a repeated block in frames, and the largest expected number of such blocks by
# chance: coarse positions also come back by themselves.
FEWEST_IN_A_ROW, CHANCE = 4, 0.01
CAUTION_SHARE = 0.01


def repeated_rows(position_nm: FloatArray) -> tuple[NDArray[np.int64], int]:
    """Rows that repeat earlier ones, block by block, and how many rows earlier most of them stand.

    Parameters
    ----------
    position_nm : (n, 3), NaN where lost; only rows with all known count.

    Returns
    -------
    (k,) ascending row numbers, empty where nothing is repeated, and the most frequent distance.
    """
    known = np.flatnonzero(np.isfinite(position_nm).all(axis=1))
    # equal rows have equal sums with any weights
    sums = position_nm[known] @ np.array([1.0, np.sqrt(2.0), np.pi])
    order = known[np.lexsort((known, sums))]
    before, after = order[:-1], order[1:]
    same = np.all(position_nm[before] == position_nm[after], axis=1)
    distance = np.zeros(len(position_nm), dtype=np.int64)
    distance[after[same]] = after[same] - before[same]
    blocks = np.split(np.arange(len(distance)), np.flatnonzero(np.diff(distance)) + 1)
    blocks = [block for block in blocks if distance[block[0]]]
    rows = [block for block in blocks if len(block) >= FEWEST_IN_A_ROW]
    # how often coarse positions come back by chance is told by rows that do so alone
    alone = sum(len(block) == 1 for block in blocks) / max(len(known), 1)
    if not rows or len(known) * alone**FEWEST_IN_A_ROW > CHANCE:
        return np.empty(0, dtype=np.int64), 0
    found = np.concatenate(rows)
    distances, how_often = np.unique(distance[found], return_counts=True)
    return found, int(distances[np.argmax(how_often)])


def without_repeats(
    positions_nm: Mapping[str, FloatArray], locate: Callable[[int], str]
) -> tuple[dict[str, FloatArray], tuple[Notice, ...]]:
    """Positions whose repeats of earlier ones are lost, as the frames they stand for are; with how
    many rows of how many beads that are, and where the first is.
    """
    found = {bead: repeated_rows(xyz) for bead, xyz in positions_nm.items()}
    found = {bead: one for bead, one in found.items() if len(one[0])}
    if not found:
        return dict(positions_nm), ()
    worst = max(found, key=lambda bead: len(found[bead][0]))
    rows, distance = found[worst]
    share = len(rows) / len(positions_nm[worst])
    earlier = "the row before" if distance == 1 else f"{distance} rows before"
    said = (
        f"{len(rows)} positions of bead {worst} ({100 * share:.2g} %) are those of {earlier} to "
        f"the last digit, first in {locate(int(rows[0]))}; {len(found)} of {len(positions_nm)} "
        "beads have such blocks. They are copies and no new frames, and count as lost."
    )
    kept = {}
    for bead, xyz in positions_nm.items():
        kept[bead] = xyz
        if bead in found:
            kept[bead] = xyz.copy()
            kept[bead][found[bead][0]] = np.nan
    notice = Notice("repeated_rows", "caution" if share > CAUTION_SHARE else "info", said)
    return kept, (notice,)
