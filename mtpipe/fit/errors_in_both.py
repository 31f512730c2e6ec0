"""Distances of measured points from a curve when both coordinates carry errors.

The true abscissa of every point is unknown and profiled out: the most likely one is where the point
is nearest to the curve in units of its errors. The sum of the squared distances is then exactly the
deviance of the Gaussian errors-in-both problem, with as many degrees of freedom as points.
Assumes a smooth rising curve and independent errors.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from mtpipe.ground.types import FloatArray


def signed_distances(
    x: FloatArray, x_error: FloatArray, y: FloatArray, y_error: FloatArray, *, curve: CubicSpline
) -> FloatArray:
    """(points,) distances from a rising curve, in standard errors, positive above it."""
    true = _most_likely(x, x_error, y, y_error, curve)
    along, across = (x - true) / x_error, (y - curve(true)) / y_error
    return np.asarray(np.copysign(np.hypot(along, across), across))


def _most_likely(
    x: FloatArray, x_error: FloatArray, y: FloatArray, y_error: FloatArray, curve: CubicSpline
) -> FloatArray:
    """(points,) true abscissae.

    The nearest point of the curve lies between the measured x and the x at which the curve takes
    the measured y; Newton steps that leave this bracket are replaced by bisection.
    """
    knots = curve.x
    x_of_y = np.interp(y, curve(knots), knots)
    spacing = float(np.diff(knots).max())
    low, high = np.minimum(x, x_of_y) - spacing, np.maximum(x, x_of_y) + spacing
    slope_of = curve.derivative()
    u = x
    for _ in range(60):
        slope = slope_of(u)
        gradient = (u - x) / x_error**2 - slope * (y - curve(u)) / y_error**2
        high, low = np.where(gradient > 0, u, high), np.where(gradient > 0, low, u)
        step = u - gradient / (1 / x_error**2 + (slope / y_error) ** 2)
        following = np.where((step > low) & (step < high), step, (low + high) / 2)
        if np.all(np.abs(following - u) < 1e-12):
            break
        u = following
    return u
