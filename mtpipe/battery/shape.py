"""Looks at how positions are distributed, before lost frames too, and at variances over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft

from mtpipe.battery.look import Look, Values
from mtpipe.battery.observed import AXES, Observed

AVERAGES = (1, 4, 16, 64, 256)
FEWEST_BLOCKS = 16
# Positions are folded at a length and binned; periods of pixels lie between those given.
FOLD_NM, FOLD_BINS = 2560.0, 512
SHORTEST_PERIOD_NM, LONGEST_PERIOD_NM = 40.0, 400.0
# From there on a Gaussian distribution has next to no amplitude of a period, in units of σ.
SMOOTH_SPREADS = 2.8
FEWEST_GAPS = 10


def moments(seen: Sequence[Observed]) -> Values:
    """Skewness and kurtosis of each trace, and over all plateaus."""
    values: Values = []
    for statistic, power in (("skewness", 3), ("kurtosis", 4)):
        for axis, name in enumerate(AXES):
            each = []
            for i, one in enumerate(seen):
                x = one.position_nm[:, axis]
                x = x[np.isfinite(x)]
                x = (x - x.mean()) / x.std()
                square = x * x
                each.append(float(np.mean(square * (x if power == 3 else square))))
                values.append((Look(statistic, name, (i,)), each[-1]))
            if len(each) > 1:
                look = Look(statistic, name, tuple(range(len(seen))), pooled=True)
                values.append((look, float(np.mean(each))))
    return values


def allan(seen: Sequence[Observed]) -> Values:
    """ln of the Allan variance of means over m frames, m growing fourfold."""
    values: Values = []
    for i, one in enumerate(seen):
        series = one.bridged_nm
        for m in AVERAGES:
            blocks = series.shape[1] // m
            if blocks < FEWEST_BLOCKS:
                break
            means = series[:, : blocks * m].reshape(3, blocks, m).mean(axis=2)
            variance = 0.5 * np.mean(np.diff(means) ** 2, axis=1)
            band = (1 / (4 * m * one.frame_s), 1 / (2 * m * one.frame_s))
            for axis, name in enumerate(AXES):
                look = Look("allan_variance", name, (i,), band)
                values.append((look, float(np.log(max(variance[axis], 1e-12)))))
    return values


def fractional_pixel(seen: Sequence[Observed]) -> Values:
    """Strongest period in the distribution of x and y in the camera's own coordinates, in ln.

    A smooth distribution has no amplitude exp(−q²σ²/2) at periods well below its width, so that
    only plateaus that move over more than a pixel tell.
    """
    values: Values = []
    periods = FOLD_NM / np.arange(1, FOLD_BINS // 2 + 1)
    for i, one in enumerate(seen):
        for axis, name in enumerate(AXES[:2]):
            x = one.position_nm[:, axis]
            there = np.isfinite(x)
            spread = float(x[there].std())
            longest = min(2 * np.pi * spread / SMOOTH_SPREADS, LONGEST_PERIOD_NM)
            searched = (periods <= longest) & (periods >= SHORTEST_PERIOD_NM)
            if not searched.any():
                # there is nothing to see, and there must be a value: what chance alone would show
                values.append(
                    (Look("fractional_pixel", name, (i,)), -0.5 * float(np.log(there.sum())))
                )
                continue
            camera = x[there] + one.camera_offset_nm[there, axis]
            bins = (np.mod(camera, FOLD_NM) * (FOLD_BINS / FOLD_NM)).astype(np.int64) % FOLD_BINS
            counts = np.bincount(bins, minlength=FOLD_BINS)
            amplitude = np.abs(fft.rfft(counts.astype(float)))[1:] / len(camera)
            values.append(
                (Look("fractional_pixel", name, (i,)), float(np.log(amplitude[searched].max())))
            )
    return values


def lost_frames(seen: Sequence[Observed]) -> Values:
    """How far from the mean the bead is before frames are lost: ln of mean square over variance."""
    values: Values = []
    for i, one in enumerate(seen):
        known = np.asarray(np.isfinite(one.position_nm).all(axis=1))
        before = np.flatnonzero(known[:-1] & ~known[1:])
        if len(before) < FEWEST_GAPS:
            continue
        series = one.bridged_nm
        for axis, name in enumerate(AXES):
            square = float(np.mean(series[axis, before] ** 2)) / float(series[axis].var())
            values.append((Look("lost_frames", name, (i,)), float(np.log(max(square, 1e-12)))))
    return values
