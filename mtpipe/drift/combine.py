"""Several reference beads made one, also where some of them are lost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.types import FloatArray

OFFSET_BLOCK_S = 1.0
QUIETEST = 0.01


def inverse_variance(noise_nm: FloatArray) -> FloatArray:
    """Weights that sum to one, of beads of the given noise; no noise counts as a hundredth."""
    if not noise_nm.any():
        return np.full(len(noise_nm), 1 / max(1, len(noise_nm)))
    weight = np.maximum(noise_nm / noise_nm.max(), QUIETEST) ** -2.0
    return np.asarray(weight / weight.sum())


def combined(series_nm: Sequence[FloatArray], weight: FloatArray, rate_hz: float) -> FloatArray:
    """Weighted mean of references, without steps where one of them is lost.

    Where some are lost the weights of the others are scaled up, after each has lost its own slow
    offset from the mean, taken from the frames that have all of them.

    Parameters
    ----------
    series_nm : each (n,), NaN where lost.
    weight : (n_references,) summing to one.
    rate_hz : frames per second.

    Returns
    -------
    (n,) nm, NaN where all are lost. References that no frame has all together cannot be joined:
    then it is the one known for longest.
    """
    if len(series_nm) == 1:
        return series_nm[0]
    mean = np.zeros_like(series_nm[0])
    for y, w in zip(series_nm, weight, strict=True):
        mean += w * y
    some = np.flatnonzero(np.isnan(mean))
    if not len(some):
        return mean
    if len(some) == len(mean):
        return max(series_nm, key=lambda y: int(np.sum(np.isfinite(y))))
    present = np.zeros(len(some))
    total = np.zeros(len(some))
    for y, w in zip(series_nm, weight, strict=True):
        here = np.isfinite(y[some])
        offset = _slow_offset(y - mean, some, rate_hz)
        total += np.where(here, w * (y[some] - offset), 0.0)
        present += w * here
    mean[some] = np.where(present > 0, total / np.where(present > 0, present, 1.0), np.nan)
    return mean


def _slow_offset(difference: FloatArray, at: NDArray[np.int64], rate_hz: float) -> FloatArray:
    """Means over a second of the known differences, interpolated to the rows `at`."""
    rows = np.flatnonzero(np.isfinite(difference))
    size = min(len(rows), max(1, round(OFFSET_BLOCK_S * rate_hz)))
    blocks = np.arange(0, len(rows), size)
    count = np.diff(np.append(blocks, len(rows)))
    centre = np.add.reduceat(rows, blocks) / count
    level = np.add.reduceat(difference[rows], blocks) / count
    return np.asarray(np.interp(at, centre, level))
