"""Looks at how positions are distributed, before lost frames too, and at variances over time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from scipy import fft

from mtpipe.crosschecking.battery.observed import Fixed, Observed
from mtpipe.crosschecking.battery.statistic import Group, Kind, Statistic, Values
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import AXES

GROWTH = 4
AVERAGES = tuple(GROWTH**k for k in range(5))
FEWEST_BLOCKS = 16
# Positions are folded at a length and binned; periods of pixels lie between those given.
FOLD_NM, FOLD_BINS = 2560.0, 512
SHORTEST_PERIOD_NM, LONGEST_PERIOD_NM = 40.0, 400.0
# Spread σ times the period's wave number, from which a Gaussian hides the period: its amplitude
# exp(−q²σ²/2) is then 2 %.
SMOOTH_SPREADS = 2.8
FEWEST_GAPS = 10
# Width of asinh(skewness/width) in D'Agostino's law of many samples: √(n/7.8) √(6/n).
SKEWNESS_SCALE = 0.877


def moments(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """Skewness and kurtosis of each trace, and over all plateaus, on scales on which their laws are
    nearly normal.

    One excursion of a slow bead makes either large: their own laws have long tails. Both scales
    change neither value where it is that of a normal distribution (`nearly_normal_skewness`,
    `nearly_normal_kurtosis`).
    """
    scales = {"skewness": nearly_normal_skewness, "kurtosis": nearly_normal_kurtosis}
    each: dict[tuple[str, str], list[float]] = {}
    for one in seen:
        for axis, name in enumerate(AXES):
            x = one.position_nm[:, axis]
            x = x[np.isfinite(x)]
            x = (x - x.mean()) / x.std()
            square = x * x
            for statistic, other in (("skewness", x), ("kurtosis", square)):
                moment = float(square @ other) / len(x)
                each.setdefault((statistic, name), []).append(scales[statistic](moment))
    values: Values = []
    for statistic, name in itertools.product(scales, AXES):
        found = each[statistic, name]
        values += [(Statistic(statistic, name, (i,)), value) for i, value in enumerate(found)]
        if len(found) > 1:
            entry = Statistic(statistic, name, tuple(range(len(seen))), pooled=True)
            values.append((entry, float(np.mean(found))))
    return values


MOMENTS = Group(
    moments,
    (
        Kind("skewness", "distribution", "skewness of the positions"),
        Kind("kurtosis", "distribution", "kurtosis of the positions"),
    ),
)


def nearly_normal_skewness(skewness: float) -> float:
    """Skewness on the scale of D'Agostino 1970 (Biometrika 57:679) for many samples.

    There α√(6/n) of its asinh, the width of the law's tails, no longer depends on their number.
    """
    return SKEWNESS_SCALE * math.asinh(skewness / SKEWNESS_SCALE)


def nearly_normal_kurtosis(kurtosis: float) -> float:
    """Kurtosis as 7 − √(32/(β − 1)): like the transform of Anscombe & Glynn 1983 (Biometrika
    70:227) for a hundred to some thousand samples, but for any kurtosis that there can be.
    """
    return 7.0 - math.sqrt(32.0 / max(kurtosis - 1.0, 1e-3))


def allan(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """ln of the Allan variance of means over m frames, m growing fourfold."""
    values: Values = []
    for i, one in enumerate(seen):
        means = one.bridged_nm
        for m in AVERAGES:
            if m > 1:
                blocks = means.shape[1] // GROWTH
                means = means[:, : blocks * GROWTH].reshape(3, blocks, GROWTH).mean(axis=2)
            if means.shape[1] < FEWEST_BLOCKS:
                break
            variance = 0.5 * np.mean(np.diff(means) ** 2, axis=1)
            band = (1 / (4 * m * one.frame_s), 1 / (2 * m * one.frame_s))
            for axis, name in enumerate(AXES):
                entry = Statistic("allan_variance", name, (i,), band)
                values.append((entry, float(np.log(max(variance[axis], 1e-12)))))
    return values


ALLAN = Group(
    allan,
    (Kind("allan_variance", "Allan variance", "Allan variance (ln nm²)", relative=False),),
)


def smooth_periods_nm(seen: Sequence[Observed]) -> FloatArray:
    """(plateaus, 2) longest period that a Gaussian distribution as wide as this one hides, x and y.

    Its amplitude of a period, exp(−q²σ²/2), is next to nothing well below its width.
    """
    spread = np.array([np.nanstd(one.position_nm[:, :2], axis=0) for one in seen])
    return np.minimum(2 * np.pi * spread / SMOOTH_SPREADS, LONGEST_PERIOD_NM)


def fractional_pixel(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """Strongest period in the distribution of x and y in the camera's own coordinates, in ln.

    Plateaus that hardly cover a pixel have no such statistic.
    """
    values: Values = []
    periods = FOLD_NM / np.arange(1, FOLD_BINS // 2 + 1)
    for i, one in enumerate(seen):
        for axis, name in enumerate(AXES[:2]):
            searched = (periods <= fixed.longest_period_nm[i, axis]) & (
                periods >= SHORTEST_PERIOD_NM
            )
            if not searched.any():
                continue
            camera = one.position_nm[:, axis] + one.camera_offset_nm[:, axis]
            camera = camera[np.isfinite(camera)]
            bins = np.floor(camera * (FOLD_BINS / FOLD_NM)).astype(np.int64) % FOLD_BINS
            counts = np.bincount(bins, minlength=FOLD_BINS)
            amplitude = np.abs(fft.rfft(counts.astype(float)))[1:] / len(camera)
            value = float(np.log(amplitude[searched].max()))
            values.append((Statistic("fractional_pixel", name, (i,)), value))
    return values


FRACTIONAL_PIXEL = Group(
    fractional_pixel,
    (
        Kind(
            "fractional_pixel", "pixel period", "strongest pattern with the period of a pixel (ln)"
        ),
    ),
)


def lost_frames(seen: Sequence[Observed], fixed: Fixed) -> Values:
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
            values.append((Statistic("lost_frames", name, (i,)), float(np.log(max(square, 1e-12)))))
    return values


LOST_FRAMES = Group(
    lost_frames,
    (Kind("lost_frames", "lost frames", "distance from the mean just before lost frames (ln)"),),
)
