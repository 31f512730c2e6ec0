"""What a look-up table can tell apart: planes whose profiles come back at another height.

Profiles are normalized ones, points on a sphere along which the bead's height moves. Noise blurs
each point alike in all directions. Two planes are confused where one image would be taken for the
other with a probability above `CONFUSION`. Neighbours always are; that is resolution, not
ambiguity. Going away from a plane, the curve leaves its surroundings once; if it comes back,
heights there and here look alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from mtpipe.ground.types import FloatArray

CONFUSION = 1e-6


def confused_with(
    profiles: FloatArray, noise: FloatArray
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which planes look like a plane that is not in their surroundings.

    Parameters
    ----------
    profiles : (m, rings) normalized. noise : (m,) standard deviation of each component.

    Returns
    -------
    (m, m) symmetric. (m,) planes that look like every other one.
    """
    # one point is taken for another at distance d with probability Q(d / 2 sigma)
    sigma = np.maximum(noise[:, None], noise[None, :])
    apart = np.linalg.norm(profiles[:, None] - profiles[None, :], axis=2)
    alike = apart < 2 * norm.isf(CONFUSION) * sigma
    confused = alike.copy()
    for i, row in enumerate(alike):
        end = i + int(np.argmin(np.append(row[i:], False)))
        begin = i - int(np.argmin(np.append(row[i::-1], False)))
        confused[i, begin + 1 : end] = False
    return confused | confused.T, np.asarray(alike.all(axis=1))


def longest_without(confused: NDArray[np.bool_]) -> tuple[int, int]:
    """The longest run [first, last) of planes of which no two are confused."""
    best, first = (0, 0), 0
    for last in range(1, len(confused) + 1):
        before = np.flatnonzero(confused[last - 1, first:last])
        if len(before):
            first += int(before[-1]) + 1
        if last - first > best[1] - best[0]:
            best = (first, last)
    return best
