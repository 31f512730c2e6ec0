"""Shapes that the force may have against the magnets' position: ln F, falling with distance.

Distance is the position counted so that the force falls with it, from the middle of the positions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.special import expit

from mtpipe.ground.types import FloatArray

# Knots inside the range of the smooth form; how many are needed the criterion says.
MOST_KNOTS = 5
CUBIC = 3


@dataclass(frozen=True)
class Form:
    """A shape of ln F against distance.

    Attributes
    ----------
    name : "single exponential", "double exponential" or "monotone spline".
    parameters, units : of `value`'s parameters.
    lower : their lower bounds. starts : where fits begin; the best end counts.
    value : (parameters, distance (n,) in mm) to ln F, (n,).
    jacobian : the same to its derivatives, (n, parameters).
    """

    name: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    lower: FloatArray
    starts: tuple[FloatArray, ...]
    value: Callable[[FloatArray, FloatArray], FloatArray]
    jacobian: Callable[[FloatArray, FloatArray], FloatArray]


def forms(distance_mm: FloatArray, log_force: FloatArray) -> list[Form]:
    """All forms that the positions at hand can determine.

    Parameters
    ----------
    distance_mm, log_force : (n,) of all forces, for where the fits begin.
    """
    distinct = np.unique(distance_mm)
    slope, height = np.polyfit(distance_mm, log_force, 1)
    rate = max(-float(slope), 1e-3)
    found = [_single(float(height), rate)]
    if len(distinct) > 4:
        found.append(_double(float(height), rate, distinct))
    knots = range(min(MOST_KNOTS, len(distinct) - CUBIC - 2) + 1)
    return found + [_spline(distinct, number, log_force) for number in knots]


def _single(height: float, rate: float) -> Form:
    def jacobian(theta: FloatArray, distance: FloatArray) -> FloatArray:
        return np.column_stack([np.ones_like(distance), -distance])

    return Form(
        "single exponential",
        ("log_force", "rate"),
        ("ln pN", "1/mm"),
        np.array([-np.inf, 0.0]),
        (np.array([height, rate]),),
        lambda theta, distance: theta[0] - theta[1] * distance,
        jacobian,
    )


def _double(height: float, rate: float, distinct: FloatArray) -> Form:
    """F = exp(a₁ − k₁u) + exp(a₂ − k₂u), the first the steeper where fits begin."""

    def value(theta: FloatArray, distance: FloatArray) -> FloatArray:
        first, fast, second, slow = theta
        return np.asarray(np.logaddexp(first - fast * distance, second - slow * distance))

    def jacobian(theta: FloatArray, distance: FloatArray) -> FloatArray:
        first, fast, second, slow = theta
        share = expit((first - fast * distance) - (second - slow * distance))
        rest = 1 - share
        return np.column_stack([share, -share * distance, rest, -rest * distance])

    starts = []
    for ratio in (1.5, 3.0):
        fast, slow, crossing = rate * ratio, rate / ratio, float(np.median(distinct))
        at = height - rate * crossing - np.log(2)
        starts.append(np.array([at + fast * crossing, fast, at + slow * crossing, slow]))
    return Form(
        "double exponential",
        ("log_force_steep", "rate_steep", "log_force_flat", "rate_flat"),
        ("ln pN", "1/mm", "ln pN", "1/mm"),
        np.array([-np.inf, 0.0, -np.inf, 0.0]),
        tuple(starts),
        value,
        jacobian,
    )


def _spline(distinct: FloatArray, knots: int, log_force: FloatArray) -> Form:
    """A cubic spline that falls: a height less I-splines with positive weights (Ramsay 1988)."""
    low, high = float(distinct[0]), float(distinct[-1])
    inside = np.quantile(distinct, np.linspace(0, 1, knots + 2)[1:-1])
    grid = np.concatenate([[low] * (CUBIC + 1), inside, [high] * (CUBIC + 1)])

    def jacobian(theta: FloatArray, distance: FloatArray) -> FloatArray:
        basis = BSpline.design_matrix(np.clip(distance, low, high), grid, CUBIC).toarray()
        # an I-spline is the sum of all B-splines from one on
        rising = np.cumsum(basis[:, ::-1], axis=1)[:, ::-1][:, 1:]
        return np.column_stack([np.ones_like(distance), -rising])

    weights = knots + CUBIC
    fall = max(float(np.ptp(log_force)), 1e-3)
    return Form(
        "monotone spline",
        ("log_force_highest", *(f"fall_{n + 1}" for n in range(weights))),
        ("ln pN", *(("1",) * weights)),
        np.array([-np.inf, *([0.0] * weights)]),
        (np.array([float(log_force.max()), *([fall / weights] * weights)]),),
        lambda theta, distance: jacobian(theta, distance) @ theta,
        jacobian,
    )
