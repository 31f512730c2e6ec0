"""How far apart a wandering stage carries the mean positions of plateaus.

A walk of unit strength that is at 0 at the time of origin has the covariance
(|t - t0| + |s - t0| - |t - s|) / 2 at times t and s; means over stretches of time have that of its
mean over both.
"""

from __future__ import annotations

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import StageCourse


def covariance_of_means(course: StageCourse, spans_s: FloatArray, origin_s: float) -> FloatArray:
    """Covariance of the course's means over stretches of time that do not overlap.

    Parameters
    ----------
    spans_s : (n, 2) begin and end of each stretch. origin_s : when the course is at 0.

    Returns
    -------
    (n, n) nm².
    """
    begin, end = np.asarray(spans_s, dtype=np.float64).T - origin_s
    middle, length = (begin + end) / 2, end - begin
    apart = np.abs(middle[:, None] - middle)
    np.fill_diagonal(apart, length / 3)
    within = (begin < 0) & (end > 0)
    away = np.where(within, (begin**2 + end**2) / (2 * length), np.abs(middle))
    walk = (away[:, None] + away - apart) / 2
    steady = middle[:, None] * middle
    return np.asarray(course.random_nm_per_root_s**2 * walk + course.steady_nm_per_s**2 * steady)
