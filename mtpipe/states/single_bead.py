"""A bead that changes for good while the others do not: it lets go, sticks, or is shortened.

That is no change of the force, and concerns this bead alone: of its plateau the longer part stays.
A bead that goes to and fro between states hops or sticks now and then; its plateau stays whole, as
the cross-check has names for that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mtpipe.recording.recording import Plateau
from mtpipe.states.change import Change, strongest_change
from mtpipe.states.motion import Motion


@dataclass(frozen=True)
class Alone:
    """A change of one bead within a plateau.

    `left_out` : rows in which the bead is not what it is in the rest of the plateau.
    `whole` : whether so little is left that the plateau is none for this bead.
    """

    bead: str
    plateau: Plateau
    change: Change
    left_out: tuple[int, int]
    whole: bool


def changes_alone(
    motion: Motion, plateaus: Sequence[Plateau], least_s: float, log_p: float
) -> list[Alone]:
    """Beads that change for good within a plateau, where there are others that do not.

    Parameters
    ----------
    least_s : shortest plateau. log_p : ln of the probability by chance, all beads tried.
    """
    found: list[Alone] = []
    beads = list(motion.position_nm)
    if len(beads) < 2:
        return found
    limit = log_p - math.log(len(beads))
    for bead in beads:
        own = replace(motion, position_nm={bead: motion.position_nm[bead]})
        for plateau in plateaus:
            change = strongest_change(own, plateau.start, plateau.stop, limit)
            if change is None:
                continue
            parts = [(plateau.start, change.low), (change.high, plateau.stop)]
            if any(strongest_change(own, *part, limit) is not None for part in parts):
                continue
            kept = max(parts, key=lambda part: part[1] - part[0])
            left = (plateau.start, kept[0]) if kept[0] > plateau.start else (kept[1], plateau.stop)
            too_short = motion.rows_s(kept[1] - kept[0]) < least_s
            found.append(Alone(bead, plateau, change, left, too_short))
    return found
