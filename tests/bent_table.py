"""Recordings whose look-up table of heights is bent (PHYSICS E28)."""

from dataclasses import replace

import numpy as np


def with_bent_table(raw, plateau, slope):
    """z of one plateau by a table whose slope changes by this over one standard deviation."""
    xyz = raw.positions_nm["b1"].copy()
    rows = slice(raw.plateaus[plateau].start, raw.plateaus[plateau].stop)
    u = xyz[rows, 2] - np.nanmean(xyz[rows, 2])
    sigma = np.nanstd(u)
    xyz[rows, 2] += slope / (2 * sigma) * (u**2 - sigma**2)
    return replace(raw, positions_nm=raw.positions_nm | {"b1": xyz})
