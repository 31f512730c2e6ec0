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
from mtpipe.states.blocks import LEAST_BLOCKS, Blocks, block_means, block_width, blocks_of
from mtpipe.states.edges import LEAST_FRAMES, sides_of
from mtpipe.states.level import FEWEST_BLOCKS, StepScores, step_scores, usual_score
from mtpipe.states.motion import Motion, height_relaxation, slowest_relaxation

# Probability that a step of one bead is taken for one that the others show too.
SUPPORT_P = 1e-2
# Nats below the best place of a change, a factor of 1000, from which others are ruled out.
LIKELY_NATS = 7.0
# Longest move of the magnets that passes for a step, and how many durations are tried.
LONGEST_MOVE_S = 3.0
DURATIONS = 12
# Each width of blocks is this many times the one before.
WIDER = 4
# Heights relax several times faster than sideways motion does along the slower axis, so that finer
# blocks tell their noise better: this many times `block_width` of their own relaxation, two
# relaxations a block. What is left of them from block to block is part of the noise.
HEIGHT_SHARE = 0.5
# A step nearer to an end than this share of a stretch, by a factor of up to 3.5, moves its force by
# less than 5 %. Beads that still follow the move before make such steps.
EDGE_SHARE = 0.02
# A larger score has a probability smaller than the least number there is, and may be infinite.
MOST_SCORE = 37.0
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
    width : frames per block of heights. blocks, scored : by bead. focus_nm : (places,) how far the
        focus moves about each. nearest : (places,) place of sideways motion, whose blocks may be
        wider, that is nearest to each. within : (places,) whether a step is looked for there.
    subtracted_nm : (blocks,) height of the references that was subtracted; None without them.
    """

    width: int
    blocks: dict[str, Blocks]
    scored: dict[str, list[StepScores]]
    focus_nm: FloatArray
    nearest: NDArray[np.int64]
    within: NDArray[np.bool_]
    subtracted_nm: FloatArray | None

    @property
    def most(self) -> list[tuple[int, float, int]]:
        """Of all beads together, in each way, and of each bead: how many tries of its kind there
        are, strength and place of the strongest step.
        """
        together = self.together(list(self.scored))
        alone = list(self.scored.values()) if len(self.scored) > 1 else []
        scores = [(len(together), one) for one in together]
        scores += [(len(alone), [each.score for each in one]) for one in alone]
        strengths = [(tries, np.where(self.within, _strength(one), -1.0)) for tries, one in scores]
        return [(tries, float(each.max()), int(np.argmax(each))) for tries, each in strengths]

    def together(self, beads: Sequence[str]) -> list[list[FloatArray]]:
        """(places,) scores of height and sideways motion of beads together, in one way or two.

        Either the noise that they share is told by the sum of their heights. Or it is at most the
        motion of the references: what the beads share, and the references do not, is the force.
        """
        blocks = [self.blocks[bead] for bead in beads]
        scored = [self.scored[bead] for bead in beads]
        found = [_of_sum(blocks, scored, self.focus_nm, self.nearest)]
        if self.subtracted_nm is not None and len(beads) > 1:
            found.append(_sum_of_scores(blocks, scored, self.subtracted_nm))
        return found


def strongest_change(motion: Motion, start: int, stop: int, log_p: float) -> Change | None:
    """The most certain change common to beads in rows [start, stop), less likely than exp(log_p) by
    chance; None where there is none.

    Changes take their time: blocks of several widths are looked at, from that of the sideways
    motion on; heights also in finer ones. The chance counts all places of both: half of it is for
    all beads together, half for those of each.
    """
    frames = stop - start
    lateral = block_width(slowest_relaxation(motion, start, stop), frames)
    fine = block_width(HEIGHT_SHARE * height_relaxation(motion, start, stop), frames)
    ladders = [
        _ladder(motion, start, stop, fine, lateral // 2, lateral),
        _ladder(motion, start, stop, lateral, frames, lateral),
    ]
    found = []
    for scans in ladders:
        places = sum(int(np.count_nonzero(scan.within)) for scan in scans)
        among = sum(1 for one in ladders if one)
        for scan in scans:
            kinds = 1 if len(scan.scored) == 1 else 2
            for tries, most, place in scan.most:
                found.append((math.log(among * places * kinds * tries) - most, place, scan))
    for chance, place, scan in sorted(found, key=lambda one: one[0]):
        if chance > log_p:
            return None
        if _common(scan, place):
            cut = start + (place + 1) * scan.width
            row, low, high = _placed(motion, start, stop, cut, scan.width)
            return Change(row, low, high, chance)
    return None


def _ladder(
    motion: Motion, start: int, stop: int, width: int, widest: int, lateral: int
) -> list[_Scan]:
    """Scans at a width of blocks and at wider ones."""
    scans: list[_Scan] = []
    while width <= widest and (stop - start) // width >= (LEAST_BLOCKS if scans else FEWEST_BLOCKS):
        scan = _scanned(motion, start, stop, width, max(width, lateral))
        if scan is not None and scan.within.any():
            scans.append(scan)
        width *= WIDER
    return scans


def _scanned(motion: Motion, start: int, stop: int, width: int, lateral: int) -> _Scan | None:
    """Heights by blocks of `width` frames; sideways motion by blocks of `lateral`, no less."""
    count = (stop - start) // width
    focus = motion.focus_nm[start + width : start + count * width : width][: count - 1]
    every = {
        bead: blocks_of(xyz[start:stop], width, lateral) for bead, xyz in motion.position_nm.items()
    }
    nearest = _nearest_places(width, count - 1, lateral, (stop - start) // lateral - 1)
    scored = {bead: _scores(one, focus, nearest) for bead, one in every.items()}
    scored = {bead: one for bead, one in scored.items() if one}
    if not scored:
        return None
    blocks = {bead: every[bead] for bead in scored}
    subtracted = motion.subtracted_nm
    if subtracted is not None:
        subtracted = block_means(subtracted[start : start + count * width], width)
    rows = (np.arange(count - 1) + 1) * width
    least = max(lateral, EDGE_SHARE * (stop - start))
    within = (rows >= least) & (rows <= stop - start - least)
    return _Scan(width, blocks, scored, focus, nearest, within, subtracted)


def _nearest_places(width: int, places: int, wider: int, there: int) -> NDArray[np.int64]:
    """(places,) the nearest of `there` places between wider blocks."""
    rows = (np.arange(places) + 1) * width
    return np.clip(np.rint(rows / wider).astype(np.int64) - 1, 0, there - 1)


def _scores(blocks: Blocks, focus_nm: FloatArray, nearest: NDArray[np.int64]) -> list[StepScores]:
    """Scores of height and sideways motion; a height that the focus may have moved has none."""
    found = []
    if blocks.height_nm is not None:
        height = step_scores(blocks.height_nm)
        found.append(_unless(np.abs(height.size) < focus_nm, height))
    if blocks.motion is not None:
        found.append(_at(step_scores(blocks.motion), nearest))
    return found


def _at(scores: StepScores, places: NDArray[np.int64]) -> StepScores:
    """The scores of some places, each as often as it is asked for."""
    return replace(scores, size=scores.size[places], score=scores.score[places])


def _unless(excused: NDArray[np.bool_], scores: StepScores) -> StepScores:
    return replace(scores, score=np.where(excused, 0.0, scores.score))


def _of_sum(
    blocks: Sequence[Blocks],
    scored: Sequence[list[StepScores]],
    focus_nm: FloatArray,
    nearest: NDArray[np.int64],
) -> list[FloatArray]:
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
        if name == "motion":
            of_sum = _at(of_sum, nearest)
        elif excused is not None:
            of_sum = _unless(excused, of_sum)
        sums.append(of_sum.score)
    return sums


def _sum_of_scores(
    blocks: Sequence[Blocks], scored: Sequence[list[StepScores]], subtracted_nm: FloatArray
) -> list[FloatArray]:
    """Sums of beads' own scores over their standard deviation, if heights share no more than the
    references' motion.
    """
    found = []
    heights = [
        one[0] for each, one in zip(blocks, scored, strict=True) if each.height_nm is not None
    ]
    if heights:
        shared = sum(usual_score(subtracted_nm, one.noise) for one in heights)
        found.append(_summed(heights) / math.hypot(math.sqrt(len(heights)), shared))
    motions = [one[-1] for each, one in zip(blocks, scored, strict=True) if each.motion is not None]
    if motions:
        found.append(_summed(motions) / math.sqrt(len(motions)))
    return found


def _summed(scores: Sequence[StepScores]) -> FloatArray:
    each = [np.clip(one.score, -MOST_SCORE, MOST_SCORE) for one in scores]
    return np.asarray(np.sum(each, axis=0))


def _strength(scores: Sequence[FloatArray]) -> FloatArray:
    """(places,) minus ln of the probability of the scores of all quantities by chance."""
    squared = np.sum([one**2 for one in scores], axis=0)
    return np.asarray(-stats.chi2.logsf(squared, len(scores)))


def _common(scan: _Scan, place: int) -> bool:
    """Whether beads beside the one that shows a step most show it too, as the same force would.

    Which way the force goes is known from that bead, so only steps of this direction count: of
    height, of sideways motion, or of both, at the place and the ones about it.
    """
    scored = {bead: [one.score for one in each] for bead, each in scan.scored.items()}
    if len(scored) == 1:
        return True
    near = slice(max(place - NEAR_BLOCKS, 0), place + NEAR_BLOCKS + 1)
    most = max(scored, key=lambda bead: float(_strength(scored[bead])[near].max()))
    others = [bead for bead in scored if bead != most]
    signs = _as_force(scored[most], [scan.blocks[most]], near)
    sign = math.copysign(1, float(signs.flat[int(np.argmax(np.abs(signs)))]))
    blocks = [scan.blocks[bead] for bead in others]
    rest = np.stack([sign * _as_force(one, blocks, near) for one in scan.together(others)])
    chance = rest.size * stats.norm.sf(float(rest.max()))
    return bool(chance < SUPPORT_P)


def _as_force(scores: Sequence[FloatArray], blocks: Sequence[Blocks], near: slice) -> FloatArray:
    """(3, places) scores of a rising force: by height, by sideways motion, which is less then, and
    by both.
    """
    each = [one[near] for one in scores]
    height = each[0] if any(one.height_nm is not None for one in blocks) else 0 * each[0]
    motion = -each[-1] if any(one.motion is not None for one in blocks) else 0 * each[0]
    return np.stack([height, motion, (height + motion) / math.sqrt(2)])


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
