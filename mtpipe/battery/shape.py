"""Looks at how positions are distributed, and at variances over growing times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtpipe.battery.look import Look, Values
from mtpipe.battery.observed import AXES, Observed

AVERAGES = (1, 4, 16, 64, 256)
FEWEST_BLOCKS = 16


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
