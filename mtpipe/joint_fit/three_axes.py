"""Algebra of symmetric 3×3 power matrices, one per bin, compiled: LAPACK is called for each by
itself.

Importing this module imports numba.
"""

from __future__ import annotations

import math

import numpy as np

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray


@compiled
def inverses(power: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverse (n_bins, 3, 3) and ln det (n_bins,) of symmetric matrices (n_bins, 3, 3).

    Of a matrix that is not positive definite, which no power is, they are nan.
    """
    inverse = np.empty_like(power)
    log_determinant = np.empty(len(power))
    for i in range(len(power)):
        xx, yy, zz = power[i, 0, 0], power[i, 1, 1], power[i, 2, 2]
        xy, xz, yz = power[i, 0, 1], power[i, 0, 2], power[i, 1, 2]
        a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        determinant = xx * a + xy * b + xz * c
        if not (xx > 0 and xx * yy > xy * xy and determinant > 0):
            determinant = math.nan
        log_determinant[i] = math.log(determinant)
        inverse[i, 0, 0] = a / determinant
        inverse[i, 1, 1] = (xx * zz - xz * xz) / determinant
        inverse[i, 2, 2] = (xx * yy - xy * xy) / determinant
        inverse[i, 0, 1] = inverse[i, 1, 0] = b / determinant
        inverse[i, 0, 2] = inverse[i, 2, 0] = c / determinant
        inverse[i, 1, 2] = inverse[i, 2, 1] = (xy * xz - xx * yz) / determinant
    return inverse, log_determinant
