"""Points of a force–extension curve against any model of it, with what moves them together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from mtpipe.fit.errors_in_both import signed_distances
from mtpipe.fit.points import ExtensionPoints
from mtpipe.ground.types import FloatArray

# Forces at which a model is evaluated, evenly over all that the points may truly have; between
# them its heights are interpolated.
GRID = 64


def curve_distances(
    points: ExtensionPoints,
    height_nm: Callable[[FloatArray], FloatArray],
    offset_nm: FloatArray | float = 0.0,
) -> FloatArray:
    """(points,) signed distances from a curve, in standard errors.

    Parameters
    ----------
    height_nm : mean extension at true forces (n,) in pN; smooth and rising.
    offset_nm : what is to be added to the extensions; forces move with their levers.
    """
    if not len(points):
        return np.zeros(0)
    log_force = np.log(points.force_pN)
    if points.lever_nm is not None:
        log_force = log_force + np.log(np.maximum(1 + offset_nm / points.lever_nm, 1e-3))
    relative_error = points.force_stderr_pN / points.force_pN
    margin = 0.1 + 6 * relative_error.max()
    grid = np.linspace(log_force.min() - margin, log_force.max() + margin, GRID)
    return signed_distances(
        log_force,
        relative_error,
        points.extension_nm + offset_nm,
        points.own_stderr_nm,
        curve=CubicSpline(grid, height_nm(np.exp(grid))),
    )
