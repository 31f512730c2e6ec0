"""The height of a bead from its radial profile, by comparison with those of known heights.

Profiles are compared as correlation does, without their mean and contrast, so that brightness and
flicker of the lamp do not matter. A ring counts as many times as it has pixels, which is least
squares over the pixels: the outer rings, of many pixels, are known best. Between planes the
profiles are a cubic spline in z, and the height is where it is nearest to the profile measured
(Gauss-Newton from the nearest plane). A parabola through the correlations of the nearest seven
planes, as in magtrack's `lookup_z`, is biased by the planes' distance: docs/tracking-accuracy.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mtpipe.ground.types import FloatArray

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

STEPS = 4


def ring_count(size_px: int) -> int:
    """Rings of a region: those that fit in it about its middle."""
    return size_px // 2


def ring_weights(rings: int) -> FloatArray:
    """(rings,) pixels that a ring holds, but for a factor: its radius; the centre holds one."""
    weights = np.arange(rings, dtype=float)
    weights[0] = 1 / (2 * np.pi)
    return weights


def normalized(profiles: FloatArray) -> FloatArray:
    """Profiles (n, rings) without mean and contrast: (n, rings) whose scalar product correlates.

    Every ring is weighted by its pixels. A flat profile gives NaN.
    """
    weights = ring_weights(profiles.shape[1])
    centred = profiles - (profiles @ weights / weights.sum())[:, None]
    scaled = centred * np.sqrt(weights)
    norm = np.linalg.norm(scaled, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(scaled / norm)


def match(
    profiles: FloatArray, planes_nm: FloatArray, planes: CubicSpline
) -> tuple[FloatArray, FloatArray]:
    """Heights of profiles, and how well they fit there.

    Parameters
    ----------
    profiles : (n, rings) as measured, none of them NaN or flat.
    planes_nm : (m,) heights of the table, increasing.
    planes : normalized profiles of the table over the height.

    Returns
    -------
    (n,) height in nm; NaN where the profile lies beyond the first or last plane.
    (n,) correlation with the table at that height, from -1 to 1.
    """
    seen, known = normalized(profiles), planes(planes_nm)
    nearest = np.argmax(seen @ known.T, axis=1)
    last = len(planes_nm) - 1
    # the nearest plane is known, so the height is sought no further than the planes beside it
    low = planes_nm[np.maximum(nearest - 1, 0)]
    high = planes_nm[np.minimum(nearest + 1, last)]
    height, step = planes_nm[nearest], np.zeros(len(seen))
    slope_of = planes.derivative()
    for _ in range(STEPS):
        slope = slope_of(height)
        step = np.sum((seen - planes(height)) * slope, axis=1) / np.sum(slope**2, axis=1)
        beyond = ((height <= planes_nm[0]) & (step < 0)) | ((height >= planes_nm[-1]) & (step > 0))
        height = np.clip(height + step, low, high)
    expected = planes(height)
    correlation = np.sum(seen * expected, axis=1) / np.linalg.norm(expected, axis=1)
    return np.where(beyond, np.nan, height), correlation
