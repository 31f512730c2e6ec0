"""Moves of the focus: plateaus cut at them, and which plateaus have the same focus.

The look-up tables of beads are not alike (PHYSICS 8.8), so a move of the focus leaves a step of its
own in each bead's height when the references are subtracted. The force does not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.notice import Notice
from mtpipe.recording.recording import Plateau, Recording
from mtpipe.states.blocks import block_width, blocks_of
from mtpipe.states.level import FEWEST_BLOCKS, step_scores
from mtpipe.states.motion import Motion, focus_moves_nm, slowest_relaxation

MOVED = "focus_moved"
# Errors of a look-up table are alike over some 50 nm of height; a shorter move changes little.
LEAST_MOVE_NM = 50.0
# Standard errors from which a step of height at a move of the focus is seen: chance makes one in a
# million.
SEEN_SIGMAS = 5.0


def cut_at_focus_moves(
    motion: Motion, plateaus: Sequence[Plateau], least_s: float
) -> tuple[tuple[Plateau, ...], list[Notice]]:
    """Plateaus without moves of the focus that are seen in a bead's height, and what is to be said.

    Parts that are shorter than `least_s` are left out. Numbers are not changed.
    """
    parts: list[Plateau] = []
    notices: list[Notice] = []
    for plateau in plateaus:
        moves = [rows for rows in _moves(motion, plateau) if _is_seen(motion, plateau, rows)]
        edges = [plateau.start, *(row for rows in moves for row in rows), plateau.stop]
        kept = [
            replace(plateau, start=start, stop=stop)
            for start, stop in zip(edges[::2], edges[1::2], strict=True)
            if motion.rows_s(stop - start) >= least_s
        ]
        parts += kept or [plateau]
        if moves and kept:
            at = ", ".join(f"{motion.time_s[(low + high) // 2]:.1f} s" for low, high in moves)
            said = (
                f"Plateau {plateau.number} is cut where the focus moves (at {at}), as heights are "
                "recorded otherwise behind it; the force is the same."
            )
            notices.append(Notice(MOVED, "info", said))
    return tuple(parts), notices


def focus_numbers(recording: Recording, plateaus: Sequence[Plateau]) -> tuple[int, ...]:
    """Number of moves of the focus before the middle of each plateau."""
    frame_s = float(np.median(np.diff(recording.time_s)))
    begins = _begins(focus_moves_nm(recording, frame_s) > LEAST_MOVE_NM)
    middles = [(plateau.start + plateau.stop) // 2 for plateau in plateaus]
    return tuple(np.searchsorted(begins, middles).tolist())


def _begins(moving: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Rows at which moves begin."""
    return np.flatnonzero(np.diff(moving.astype(np.int8), prepend=0) > 0)


def _moves(motion: Motion, plateau: Plateau) -> list[tuple[int, int]]:
    """First row of each move within a plateau and the first row behind it."""
    moving = motion.focus_nm[plateau.start : plateau.stop] > LEAST_MOVE_NM
    starts = plateau.start + _begins(moving)
    stops = plateau.start + np.flatnonzero(np.diff(moving.astype(np.int8), append=0) < 0) + 1
    return list(zip(starts.tolist(), stops.tolist(), strict=True))


def _is_seen(motion: Motion, plateau: Plateau, rows: tuple[int, int]) -> bool:
    """Whether the height of a bead steps where the focus moves."""
    start, stop = plateau.start, plateau.stop
    width = block_width(slowest_relaxation(motion, start, stop), stop - start)
    for xyz in motion.position_nm.values():
        height = blocks_of(xyz[start:stop], width).height_nm
        if height is None or len(height) < FEWEST_BLOCKS:
            continue
        first = max((rows[0] - start) // width - 1, 0)
        near = step_scores(height).score[first : (rows[1] - start) // width + 1]
        if len(near) and float(np.max(np.abs(near))) > SEEN_SIGMAS:
            return True
    return False
