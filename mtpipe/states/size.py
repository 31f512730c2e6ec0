"""How much the force changes between two stretches, as sideways motion and heights tell it."""

from __future__ import annotations

import math

import numpy as np

from mtpipe.states.blocks import relaxation_frames
from mtpipe.states.motion import Motion, independent_share, middle

LEAST_FRAMES = 16
# Standard errors by which sideways motion has to contradict heights for a change to be none of the
# force: by chance in one of 400.
CONTRADICTION_SIGMAS = 3.0
# A change of ln F that matters.
LEAST_LOG_CHANGE = 0.05


def force_change(motion: Motion, before: slice, after: slice) -> tuple[float, float]:
    """ln of force after over force before with its standard error, from sideways motion: F ∝ 1/var.

    The chain's length, on which the force depends too, changes by far less. Squares are independent
    once per relaxation time; beads and axes that scatter more have a larger error. nan, inf where
    nothing is known.
    """
    logs, weights = [], []
    for xyz in motion.position_nm.values():
        for axis in (0, 1):
            one, other = xyz[before, axis], xyz[after, axis]
            counts = [int(np.isfinite(column).sum()) for column in (one, other)]
            if min(counts) < LEAST_FRAMES:
                continue
            variances = float(np.nanvar(one)), float(np.nanvar(other))
            if min(variances) <= 0:
                continue
            slow = max(relaxation_frames(middle(one)), relaxation_frames(middle(other)), 1.0)
            logs.append(math.log(variances[0] / variances[1]))
            weights.append(1 / (2 * slow * (1 / counts[0] + 1 / counts[1])))
    if not logs:
        return math.nan, math.inf
    log, stderr = float(np.average(logs, weights=weights)), sum(weights) ** -0.5
    if len(logs) > 2:
        stderr = max(stderr, float(np.std(logs, ddof=1)) / math.sqrt(len(logs)))
    return log, stderr


def heights_contradicted(motion: Motion, before: slice, after: slice) -> bool:
    """Whether heights change by far more than a force that sideways motion allows could make.

    By equipartition dz/dln F = F/k_z = z var(z)/var(x), which noise and blur make uncertain by some
    times: sideways motion has to exclude half of what heights ask for, and any change that matters.
    """
    asked = []
    for xyz in motion.position_nm.values():
        heights = [float(np.nanmean(xyz[rows, 2])) for rows in (before, after)]
        spread = np.nanvar(xyz[after], axis=0)
        lateral = float(np.nanmean(spread[:2]))
        if lateral > 0 and spread[2] > 0 and heights[1] > 0:
            slope = heights[1] * float(spread[2]) / lateral
            asked.append((heights[1] - heights[0]) / slope)
    told, stderr = force_change(motion, before, after)
    if not asked or not math.isfinite(told):
        return False
    wanted = float(np.median(asked))
    most = math.copysign(told, told * wanted) + CONTRADICTION_SIGMAS * stderr
    return most < min(abs(wanted) / 2, LEAST_LOG_CHANGE)


def heights_go_both_ways(motion: Motion, before: slice, after: slice) -> bool:
    """Whether some beads rise for certain and others fall, which no force makes them do, while
    sideways motion shows no certain change of the force.
    """
    scores = []
    for xyz in motion.position_nm.values():
        sides = [xyz[rows, 2] for rows in (before, after)]
        counts = [independent_share(z) * np.isfinite(z).sum() for z in sides]
        if min(counts) > 0:
            variance = sum(float(np.nanvar(z)) / n for z, n in zip(sides, counts, strict=True))
            scores.append(float(np.nanmean(sides[1]) - np.nanmean(sides[0])) / math.sqrt(variance))
    told, stderr = force_change(motion, before, after)
    if not scores or abs(told) > CONTRADICTION_SIGMAS * stderr:
        return False
    return min(max(scores), -min(scores)) > CONTRADICTION_SIGMAS
