"""Mistracked frames: positions that no bead can have reached, to be treated as lost.

A tracker that locks onto the wrong ring or the wrong bead jumps by far more than the bead moves.
Such frames are found against a running median, so that neither slow drift nor the mistracked
frames themselves set the scale.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage, stats

from mtpipe.ground.types import FloatArray

# A Gaussian trace of 10⁷ frames exceeds 5.6 standard deviations once; heavy-tailed but real motion
# (hopping, sticking) stays well below twice that.
OUTLIER_SIGMAS = 12.0
MEDIAN_FRAMES = 101


def without_mistracked(trace_nm: FloatArray) -> tuple[FloatArray, int]:
    """Blank the frames in which a position is an outlier on any axis.

    Parameters
    ----------
    trace_nm : (n_frames, 3), NaN where lost.

    Returns
    -------
    The trace with mistracked frames set to NaN on all axes (a tracker that is wrong in z used the
    wrong centre in x and y), and their number.
    """
    bad = np.zeros(len(trace_nm), dtype=bool)
    for column in trace_nm.T:
        present = np.isfinite(column)
        if present.sum() < MEDIAN_FRAMES:
            continue
        values = column[present]
        # the wide median survives a burst; the plateau's own spread keeps real slow motion inside
        away = np.abs(values - ndimage.median_filter(values, MEDIAN_FRAMES, mode="nearest"))
        spread = float(stats.median_abs_deviation(values, scale="normal"))
        local = float(np.median(away) / stats.norm.ppf(0.75))
        flagged = away > OUTLIER_SIGMAS * max(spread, local, 1e-9)
        far = np.abs(values - np.median(values)) > 2 * OUTLIER_SIGMAS * max(spread, 1e-9)
        bad[np.flatnonzero(present)[flagged | far]] = True
    if not bad.any():
        return trace_nm, 0
    cleaned = trace_nm.copy()
    cleaned[bad] = np.nan
    return cleaned, int(bad.sum())
