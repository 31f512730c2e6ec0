"""The mean of a trace with its standard error, samples being correlated and frames missing.

Assumes a stationary trace of an equilibrium motion with any number of relaxation times, plus
tracking noise. Such an autocovariance is positive and falls steadily, which is what tells signal
from chance (Geyer 1992, Statist. Sci. 7:473, the initial monotone sequence). Sokal's window of
five autocorrelation times, tried as well, stops too early when slow motion of small amplitude
hides under tracking noise: its error bars were half the scatter for a relaxation time of 100
frames under noise of three times the amplitude.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from mtpipe.ground.types import FloatArray

_COARSE = 16
_FEWEST_BLOCKS = 50


def mean_with_stderr(trace_nm: FloatArray) -> tuple[float, float]:
    """Mean of a trace and its standard error.

    The sum over the autocovariance is taken frame by frame and once more over blocks of 16 frames,
    in which tracking noise hides slow motion less; the larger one counts. Covers the true mean in
    68 to 73 % of simulated traces of 8192 frames (68 % nominal) for relaxation times up to 100
    frames, with noise or without; in 60 % when the trace lasts only ten relaxation times.

    Parameters
    ----------
    trace_nm : (n_frames,) on the camera's regular grid, NaN where a frame is lost.

    Returns
    -------
    mean, standard error : nm; both NaN for fewer than two frames.
    """
    seen = np.isfinite(trace_nm)
    count = int(seen.sum())
    if count < 2:
        return float("nan"), float("nan")
    mean = float(trace_nm[seen].mean())
    deviation = np.where(seen, trace_nm - mean, 0.0)
    variance = _variance_of_mean(deviation, seen.astype(np.float64))
    blocks = len(trace_nm) // _COARSE
    if blocks >= _FEWEST_BLOCKS:
        shape = (blocks, _COARSE)
        used = slice(0, blocks * _COARSE)
        coarse = _variance_of_mean(
            deviation[used].reshape(shape).sum(axis=1), seen[used].reshape(shape).sum(axis=1)
        )
        variance = max(variance, coarse)
    return mean, float(np.sqrt(variance))


def _variance_of_mean(deviation: FloatArray, weight: NDArray[np.float64]) -> float:
    """Variance of sum(deviation) / sum(weight), deviations being sums over `weight` samples."""
    products, pairs = _autocorrelate(deviation), _autocorrelate(weight)
    even = len(products) // 2 * 2
    steps = products[0:even:2] + products[1:even:2]
    # The first pair sum that is not positive is noise, and so is all after it.
    end = int(np.argmax(steps <= 0)) if np.any(steps <= 0) else len(steps)
    steps = np.minimum.accumulate(steps[: max(end, 1)])
    window = 2 * len(steps)
    total = 2 * steps.sum() - products[0]
    # Deviations are from the sample's mean, so each product is low by the variance of that mean.
    unaffected = weight.sum() ** 2 - (2 * pairs[:window].sum() - pairs[0])
    return float(max(total, 0.0) / unaffected) if unaffected > 0 else float("nan")


def _autocorrelate(values: FloatArray) -> FloatArray:
    """Sums of products at lags 0 to n - 1."""
    n = len(values)
    size = fft.next_fast_len(2 * n, real=True)
    return np.asarray(fft.irfft(np.abs(fft.rfft(values, size)) ** 2, size)[:n])
