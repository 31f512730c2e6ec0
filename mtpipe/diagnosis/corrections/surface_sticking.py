"""The bead or the tether binds to the surface for a while (PHYSICS E18).

A bound bead stands still, or moves about the point at which it was caught with a stiffer spring, on
all axes at once. Stretches of time are looked for in which a first-order autoregression with a
point of rest of its own, stiffer or frozen, explains two axes or more far better than that of the
whole plateau: a scan over all starts and many lengths by likelihood ratio. The stretches are
blanked and the rest is fitted again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.crosschecking.check import BeadCheck
from mtpipe.diagnosis.corrections.correction import Correction, Strength
from mtpipe.diagnosis.corrections.retraced import with_positions
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.spectra.correlation import lag_one_correlation

REMEDY = "passivate the surface better, or leave out the plateaus of low force."

NAME = "surface_sticking"
# Kinds of bound bead that are tried. STIFFER: stiffness over that of the free bead. STILL: variance
# of a frozen bead over that of a free bead's random move in one frame.
STIFFER = (4.0, 16.0)
STILL = (0.3, 0.1, 0.01)
SHORTEST_FRAMES, LENGTH_GROWTH, LONGEST_SHARE = 4, 1.25, 0.4
# Least gain (nats, all axes) of a bound bead over a free one in a stretch. Clean recordings of
# 65 000 frames reach 16. The best axis counts as the second best: one alone may rest between hops.
NEEDED_NATS = 20.0
# Margin blanked on each side of a bound stretch, in frames and as a share of the stretch: its edges
# are known only roughly.
MARGIN_FRAMES, MARGIN_SHARE = 2, 0.08


@dataclass(frozen=True)
class Stretch:
    """Frames [start, stop) in which the bead is bound, and the evidence for it."""

    start: int
    stop: int
    nats: float


def find(check: BeadCheck) -> Correction | None:
    """Stretches in which the bead is bound, blanked; None where there are none."""
    case = check.case
    found = [bound_stretches(position) for position in case.positions_nm]
    frames = np.array([s.stop - s.start for stretches in found for s in stretches])
    if not len(frames):
        return None
    positions = tuple(
        blanked(position, stretches)
        for position, stretches in zip(case.positions_nm, found, strict=True)
    )
    try:
        corrected = with_positions(case, positions)
    except FitError:
        return None
    total = sum(len(position) for position in case.positions_nm)
    count, share = len(frames), float(frames.sum()) / total
    mean_s = float(frames.mean()) * case.frame_s
    # as many episodes as came, each as long as it took: both are chance
    strengths = (
        Strength("share of time", share, share * math.sqrt(2 / count), ""),
        Strength("episodes", float(count), math.sqrt(count), ""),
        Strength("mean duration", mean_s, mean_s / math.sqrt(count), "s"),
    )
    times = "once" if count == 1 else f"{count} times"
    cause = (
        f"the bead or the tether sticks to the surface {times}, {mean_s:.2g} s at a time, "
        f"{share:.1%} of the time"
    )
    return Correction(NAME, corrected, strengths, cause)


def blanked(position_nm: FloatArray, stretches: list[Stretch]) -> FloatArray:
    """The trace with stretches and a margin about them lost."""
    cleaned = position_nm.copy()
    for one in stretches:
        margin = MARGIN_FRAMES + round(MARGIN_SHARE * (one.stop - one.start))
        cleaned[max(one.start - margin, 0) : one.stop + margin] = np.nan
    return cleaned


def bound_stretches(position_nm: FloatArray) -> list[Stretch]:
    """Stretches in which a bead is bound, in time order.

    Parameters
    ----------
    position_nm : (n, 3) on the camera's grid, NaN where lost.
    """
    axes = [_Sums(x) for x in position_nm.T]
    free = np.ones(len(position_nm), dtype=bool)
    candidates = []
    length = float(SHORTEST_FRAMES)
    while length < LONGEST_SHARE * len(position_nm):
        n = round(length)
        nats = np.sort([axis.gains(n) for axis in axes], axis=0)
        total = nats[0] + 2 * nats[1]
        at = np.flatnonzero(total > NEEDED_NATS)
        candidates += [Stretch(int(i), int(i) + n, float(total[i])) for i in at]
        length = max(length * LENGTH_GROWTH, length + 1)
    found = []
    for one in sorted(candidates, key=lambda stretch: stretch.nats, reverse=True):
        if free[one.start : one.stop].all():
            free[one.start : one.stop] = False
            found.append(one)
    return _joined(sorted(found, key=lambda stretch: stretch.start))


def _joined(stretches: list[Stretch]) -> list[Stretch]:
    """Pieces of the same episode taken together."""
    joined: list[Stretch] = []
    for one in stretches:
        last = joined[-1] if joined else None
        if last is not None:
            longer = max(last.stop - last.start, one.stop - one.start)
            if one.start - last.stop <= MARGIN_FRAMES + 2 * MARGIN_SHARE * longer:
                joined[-1] = replace(last, stop=one.stop, nats=last.nats + one.nats)
                continue
        joined.append(one)
    return joined


class _Sums:
    """One axis: running sums from which the gain of any stretch follows at once."""

    def __init__(self, x: FloatArray) -> None:
        deviation = x - np.nanmean(x)
        pairs = deviation[1:] * deviation[:-1]
        known = np.isfinite(pairs)
        self.count = _running(known.astype(float))
        variance = float(np.nanmean(deviation**2))
        ratio = float(np.clip(lag_one_correlation(deviation), 0.0, 0.9999))
        kick = variance * (1 - ratio**2)
        bound = [(ratio**k, variance / k * (1 - ratio ** (2 * k)) / kick) for k in STIFFER] + [
            (0.0, share) for share in STILL
        ]
        filled = np.where(np.isfinite(deviation), deviation, 0.0) / math.sqrt(kick)

        def innovations(own_ratio: float) -> FloatArray:
            return np.where(known, filled[1:] - own_ratio * filled[:-1], 0.0)

        self.free = _running(innovations(ratio) ** 2)
        self.bound = []
        for own_ratio, size in bound:
            kicks = innovations(own_ratio)
            # the point of rest may be wherever the free bead goes
            spread = variance / kick * (1 - own_ratio) ** 2 / size
            self.bound.append((size, spread, _running(kicks), _running(kicks**2)))

    def gains(self, frames: int) -> FloatArray:
        """(n − frames,) nats by which the frames after each are better explained by a bound bead,
        beyond what is usual in this plateau.
        """

        def total(running: FloatArray) -> FloatArray:
            # the innovation into a stretch's first frame is no part of it
            return np.asarray(running[frames:] - running[1 : len(running) - frames + 1])

        count, free = total(self.count), total(self.free)
        best = np.zeros(len(count))
        for size, spread, first, second in self.bound:
            # the mean of the innovations is unknown, normal about 0 with this spread
            mean_square = total(first) ** 2 / (count + 1 / spread)
            about_mean = (total(second) - mean_square) / size
            width = count * math.log(size) + np.log1p(count * spread)
            best = np.maximum(best, 0.5 * (free - about_mean - width))
        return np.asarray(best - np.median(best))


def _running(values: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(values)])
