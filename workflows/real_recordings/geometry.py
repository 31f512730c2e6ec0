"""What a bead's motion in the plane of the surface says of its attachment and of the field's axis.

Magnets that turn carry a bead on a circle about its anchor. Its radius is the distance of the
attachment from the bead's axis, as the bead turns freely about the field's lines but not about
any other: the attachment hangs in the plane of field and force (PHYSICS E4). A bead at rest stands
on that circle, in the direction of the field's axis, and moves more across the field than along.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

FloatArray = NDArray[np.float64]
FARTHEST_NM = 900.0
USUAL_WIDTH_NM = 40.0


@dataclass(frozen=True)
class Circle:
    """A circle in the plane, in nm."""

    x_nm: float
    y_nm: float
    radius_nm: float

    def direction_degree(self, position_nm: FloatArray) -> float:
        """Direction of the mean of positions (n, 3) from the centre, modulo 180 degrees."""
        x, y = np.nanmedian(position_nm[:, :2], axis=0)
        return math.degrees(math.atan2(y - self.y_nm, x - self.x_nm)) % 180


def circle(position_nm: FloatArray) -> Circle:
    """Circle through the positions (n, 3) of a bead that turning magnets carry round.

    Distances beyond the width of the ring count by their size only, mistracked ones not at all.
    """
    xy = position_nm[np.isfinite(position_nm).all(axis=1), :2]
    middle = np.median(xy, axis=0)
    xy = xy[np.all(np.abs(xy - middle) < FARTHEST_NM, axis=1)]

    def distances(circle: FloatArray) -> FloatArray:
        return np.hypot(xy[:, 0] - circle[0], xy[:, 1] - circle[1]) - circle[2]

    start = [*middle, float(np.median(np.hypot(*(xy - middle).T)))]
    fit = optimize.least_squares(distances, start, loss="soft_l1", f_scale=USUAL_WIDTH_NM)
    return Circle(*(float(value) for value in fit.x))


def attachment_height_nm(circle: Circle, radius_nm: float) -> float:
    """How far below the bead's centre the attachment hangs."""
    return math.sqrt(max(radius_nm**2 - circle.radius_nm**2, 0.0))


def stiff_direction_degree(position_nm: FloatArray, window: int = 2000) -> tuple[float, float]:
    """Direction of least motion modulo 180 degrees, and the ratio of largest to least variance.

    Means over `window` frames are taken off first, so that slow motion does not count.
    """
    xy = position_nm[np.isfinite(position_nm).all(axis=1), :2]
    xy = xy[np.all(np.abs(xy - np.median(xy, axis=0)) < FARTHEST_NM, axis=1)]
    pieces = xy[: len(xy) // window * window].reshape(-1, window, 2)
    centred = (pieces - pieces.mean(axis=1, keepdims=True)).reshape(-1, 2)
    variance, axes = np.linalg.eigh(np.cov(centred.T))
    direction = math.degrees(math.atan2(axes[1, 0], axes[0, 0])) % 180
    return direction, float(variance[1] / variance[0])
