"""Expected power of exponential covariances seen through a window, compiled: fits ask for it most.

Importing this module imports numba.
"""

from __future__ import annotations

import math

import numpy as np

from mtpipe.compiled import compiled
from mtpipe.physics.camera import FloatArray


@compiled
def unit_power(
    tau: FloatArray,
    white: FloatArray,
    correlated: FloatArray,
    of_white: FloatArray,
    of_lag: FloatArray,
    knots: FloatArray,
    cubics: FloatArray,
) -> FloatArray:
    """Expected binned periodogram, over 2D, of modes of unit variance.

    Parameters
    ----------
    tau : (n,) relaxation times over the frame interval.
    white, correlated : (n,) how much of each mode is which (`physics.camera.recorded_parts`).
    of_white : (n_bins,) what a window makes of white noise.
    of_lag : (lags, n_bins) what it makes of unit covariance at lag ±1, ±2, …
    knots, cubics : (k + 1,) and (4, k, n_bins) of the spline over ln τ, in equal steps, of the
        logarithm of what it makes of the covariance e^{−|m|/τ}.

    Returns
    -------
    (n, n_bins).
    """
    bins = len(of_white)
    power = np.empty((len(tau), bins))
    for mode in range(len(tau)):
        if tau[mode] >= 1:
            x = math.log(tau[mode])
            at = int((x - knots[0]) / (knots[1] - knots[0]))
            at = min(max(at, 0), cubics.shape[1] - 1)
            x -= knots[at]
            for i in range(bins):
                ln = (cubics[0, at, i] * x + cubics[1, at, i]) * x + cubics[2, at, i]
                decaying = math.exp(ln * x + cubics[3, at, i])
                power[mode, i] = white[mode] * of_white[i] + correlated[mode] * decaying
        else:
            for i in range(bins):
                power[mode, i] = white[mode] * of_white[i]
            decay, left = math.exp(-1 / tau[mode]), correlated[mode]
            for lag in range(len(of_lag)):
                for i in range(bins):
                    power[mode, i] += left * of_lag[lag, i]
                left *= decay
    return power
