"""Changes of the force within a stretch that the log calls one dwell.

All beads of a recording are looked at together: a step of their mean height, or of how much they
move sideways, at one time. One bead alone makes no change of the force, however strong it is: where
there are several, the others have to show it too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mtpipe.ground.types import FloatArray
from mtpipe.states.blocks import LEAST_BLOCKS, Blocks, block_width, blocks_of
from mtpipe.states.edges import LEAST_FRAMES, sides_of
from mtpipe.states.level import FEWEST_BLOCKS, StepScores, step_scores
from mtpipe.states.motion import Motion, slowest_relaxation

# Probability that a step of one bead is taken for one that the others show too.
SUPPORT_P = 1e-3
# Nats below the best place of a change, a factor of 1000, from which others are ruled out.
LIKELY_NATS = 7.0
# Longest move of the magnets that passes for a step, and how many durations are tried.
LONGEST_MOVE_S = 3.0
DURATIONS = 12
# Each width of blocks is this many times the one before.
WIDER = 4
# A step is at most this many blocks off where the blocks place it.
NEAR_BLOCKS = 2


@dataclass(frozen=True)
class Change:
    """A step between two rows of a stretch.

    Attributes
    ----------
    row : the first of the new state, most likely. low, high : rows between which it is for certain.
    log_p : ln of the probability of as strong a step by chance, all places of the stretch tried.
    """

    row: int
    low: int
    high: int
    log_p: float


@dataclass(frozen=True)
class _Scan:
    """All places of a stretch at one width of blocks.

    Attributes
    ----------
    blocks, scored : by bead. focus_nm : (places,) how far the focus moves about each.
    together : scores of all beads together.
    """

    width: int
    blocks: dict[str, Blocks]
    scored: dict[str, list[StepScores]]
    focus_nm: FloatArray
    together: list[StepScores]

    @property
    def most(self) -> list[tuple[float, int]]:
        """Strength and place of the strongest step of all beads together, and of each."""
        looked = [self.together, *(one for one in self.scored.values() if len(self.scored) > 1)]
        strengths = [_strength(one) for one in looked]
        return [(float(each.max()), int(np.argmax(each))) for each in strengths]


def strongest_change(motion: Motion, start: int, stop: int, log_p: float) -> Change | None:
    """The most certain change common to beads in rows [start, stop), less likely than exp(log_p) by
    chance; None where there is none.

    Changes take their time: blocks of several widths are looked at.
    """
    width = block_width(slowest_relaxation(motion, start, stop), stop - start)
    scans: list[_Scan] = []
    while (stop - start) // width >= (LEAST_BLOCKS if scans else FEWEST_BLOCKS):
        scan = _scanned(motion, start, stop, width)
        if scan is not None:
            scans.append(scan)
        width *= WIDER
    found = [(most, place, scan) for scan in scans for most, place in scan.most]
    tried = sum(len(scan.focus_nm) * len(scan.most) for scan in scans)
    for most, place, scan in sorted(found, key=lambda one: -one[0]):
        chance = math.log(tried) - most
        if chance > log_p:
            return None
        if _common(scan, place):
            cut = start + (place + 1) * scan.width
            row, low, high = _placed(motion, start, stop, cut, scan.width)
            return Change(row, low, high, chance)
    return None


def _scanned(motion: Motion, start: int, stop: int, width: int) -> _Scan | None:
    count = (stop - start) // width
    focus = motion.focus_nm[start + width : start + count * width : width][: count - 1]
    every = {bead: blocks_of(xyz[start:stop], width) for bead, xyz in motion.position_nm.items()}
    scored = {bead: _scores(one, focus) for bead, one in every.items()}
    scored = {bead: one for bead, one in scored.items() if one}
    if not scored:
        return None
    blocks = {bead: every[bead] for bead in scored}
    together = _together(list(blocks.values()), list(scored.values()), focus)
    return _Scan(width, blocks, scored, focus, together)


def _scores(blocks: Blocks, focus_nm: FloatArray) -> list[StepScores]:
    """Scores of height and sideways motion; a height that the focus may have moved has none."""
    found = [step_scores(one) for one in (blocks.height_nm, blocks.motion) if one is not None]
    if blocks.height_nm is not None:
        found[0] = _unless(np.abs(found[0].size) < focus_nm, found[0])
    return found


def _unless(excused: NDArray[np.bool_], scores: StepScores) -> StepScores:
    return replace(scores, score=np.where(excused, 0.0, scores.score))


def _together(
    blocks: Sequence[Blocks], scored: Sequence[list[StepScores]], focus_nm: FloatArray
) -> list[StepScores]:
    """Scores of the sum over beads, each over its noise; noise that they share is the sum's too."""
    sizes = [s[0].size for b, s in zip(blocks, scored, strict=True) if b.height_nm is not None]
    excused = np.median(np.abs(sizes), axis=0) < focus_nm if sizes else None
    sums = []
    for name in ("height_nm", "motion"):
        total = None
        for one, scores in zip(blocks, scored, strict=True):
            level = getattr(one, name)
            if level is None:
                continue
            noise = scores[-1 if name == "motion" else 0].noise
            each = level / math.sqrt(noise.white * (2 + noise.walk_share))
            total = each if total is None else total + each
        if total is None:
            continue
        of_sum = step_scores(total)
        if name == "height_nm" and excused is not None:
            of_sum = _unless(excused, of_sum)
        sums.append(of_sum)
    return sums


def _strength(scores: Sequence[StepScores]) -> FloatArray:
    """(places,) minus ln of the probability of the scores of all quantities by chance."""
    squared = np.sum([one.score**2 for one in scores], axis=0)
    return np.asarray(-stats.chi2.logsf(squared, len(scores)))


def _common(scan: _Scan, place: int) -> bool:
    """Whether beads beside the one that shows a step most show it too, and the same way."""
    scored = scan.scored
    if len(scored) == 1:
        return True
    near = slice(max(place - NEAR_BLOCKS, 0), place + NEAR_BLOCKS + 1)
    most = max(scored, key=lambda bead: float(_strength(scored[bead])[near].max()))
    others = [bead for bead in scored if bead != most]
    rest = _together(
        [scan.blocks[bead] for bead in others], [scored[bead] for bead in others], scan.focus_nm
    )
    strength = _strength(rest)[near]
    at = int(np.argmax(strength))
    lead = int(np.argmax([abs(one.score[near][at]) for one in rest]))
    same = rest[lead].score[near][at] * _nearest(scored[most], lead, near) > 0
    return bool(same and strength[at] > math.log((2 * NEAR_BLOCKS + 1) / SUPPORT_P))


def _nearest(scores: Sequence[StepScores], quantity: int, near: slice) -> float:
    score = scores[min(quantity, len(scores) - 1)].score[near]
    return float(score[int(np.argmax(np.abs(score)))])


def _placed(motion: Motion, start: int, stop: int, cut: int, width: int) -> tuple[int, int, int]:
    """Row of the middle of a change, and rows between which it happens, with all beads together.

    Motors take their time: courses of several durations are tried, and all that are about as
    likely as the best count.
    """
    sides = sides_of(motion, start, stop, cut, cut)
    least = LEAST_FRAMES
    if sides is None or stop - start < 4 * least:
        return cut, max(cut - 2 * width, start), min(cut + 2 * width, stop)
    longest = min(LONGEST_MOVE_S / motion.frame_s, (stop - start) / 4)
    durations = [0, *np.unique(np.geomspace(1, max(longest, 1), DURATIONS).astype(int)).tolist()]
    tried = []
    for duration in durations:
        change = np.arange(least, stop - start - duration - least)
        progress = (np.arange(duration) + 1.0) / (duration + 1)
        tried.append((change, duration, sides.log_likelihood(progress, change)))
    most = max(float(each.max()) for _, _, each in tried)
    best, low, high = cut, stop, start
    for change, duration, each in tried:
        likely = change[each > most - LIKELY_NATS]
        if len(likely):
            low = min(low, start + int(likely[0]))
            high = max(high, start + int(likely[-1]) + duration)
        if float(each.max()) == most:
            best = start + int(change[int(np.argmax(each))]) + duration // 2
    return best, low, high
