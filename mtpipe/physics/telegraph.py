"""Telegraph motion between two states: the loops in time, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray


@compiled
def mean_states(keeps: NDArray[np.bool_], drawn: NDArray[np.bool_], exposed: int) -> FloatArray:
    """(frames,) share of the first `exposed` parts of each frame in the longer state.

    Parameters
    ----------
    keeps : (frames, parts) whether a part is in the state of the one before; the first does not.
    drawn : (frames, parts) whether it is in the longer one where it does not keep it.
    """
    frames, parts = keeps.shape
    found = np.empty(frames)
    longer = False
    for frame in range(frames):
        count = 0
        for part in range(parts):
            if not keeps[frame, part]:
                longer = drawn[frame, part]
            if longer and part < exposed:
                count += 1
        found[frame] = count / exposed
    return found


@compiled
def two_state_nats(
    values: FloatArray, low: float, high: float, share: float, keeps: float, variance: float
) -> float:
    """ln likelihood of (n,) values about two levels, white noise of this variance beside them.

    The forward recursion of a hidden Markov chain (Rabiner 1989, Proc. IEEE 77, 257, Eq. 19-21).

    Parameters
    ----------
    low, high : the levels. share : of the time at the high one.
    keeps : probability that the next value's level is not drawn anew.
    """
    nats, there = -0.5 * len(values) * math.log(2 * math.pi * variance), share
    for value in values:
        # the larger exponent is taken out, so that both may be small
        at_low = -0.5 * (value - low) ** 2 / variance
        at_high = -0.5 * (value - high) ** 2 / variance
        most = max(at_low, at_high)
        low_weight = (1 - there) * math.exp(at_low - most)
        high_weight = there * math.exp(at_high - most)
        total = max(low_weight + high_weight, 1e-300)
        nats += most + math.log(total)
        there = keeps * high_weight / total + (1 - keeps) * share
    return nats


@compiled
def gaussian_nats(values: FloatArray, hopping: float, keeps: float, variance: float) -> float:
    """As `two_state_nats`, about a Gaussian that has the variance and the correlation of the hops.

    Kalman 1960 (J. Basic Eng. 82, 35) with one hidden number.
    """
    nats, mean, spread = 0.0, 0.0, hopping
    for value in values:
        whole = spread + variance
        off = value - mean
        nats -= 0.5 * (math.log(2 * math.pi * whole) + off * off / whole)
        gain = spread / whole
        mean = keeps * (mean + gain * off)
        spread = keeps * keeps * (1 - gain) * spread + (1 - keeps * keeps) * hopping
    return nats
