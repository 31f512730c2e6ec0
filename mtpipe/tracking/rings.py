"""The radial profile of a bead's image: its mean brightness on rings about its centre.

Rings stand one pixel apart. A pixel between two rings counts for both, the nearer one the more, so
that a profile changes steadily when the bead moves against the pixels; counted for the nearest ring
alone, as magtrack's `radial_profile` does, z follows the pixels by 5 to 10 nm
(docs/tracking-accuracy.md). Only whole rings are used: the first is the centre, the last half a
region away. Importing this module imports numba.
"""

from __future__ import annotations

import numpy as np

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray
from mtpipe.tracking.matching import ring_count


def profiles(
    images: FloatArray, x_px: FloatArray, y_px: FloatArray, saturated_above: float = np.inf
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Radial profiles of images (n, size, size) about centres (n,).

    Parameters
    ----------
    saturated_above : grey level from which on a pixel counts as saturated.

    Returns
    -------
    (n, rings) mean brightness; NaN throughout for an image whose centre is NaN.
    (n,) share of the variance within the rings that the profile explains, from 0 to 1.
    (n,) largest share of saturated pixels in any ring.
    """
    rings = ring_count(images.shape[1])
    found = np.full((len(images), rings), np.nan)
    explained, saturated = np.full(len(images), np.nan), np.zeros(len(images))
    _profiles(images, x_px, y_px, saturated_above, found, explained, saturated)
    return found, explained, saturated


@compiled
def _profiles(
    images: FloatArray,
    x_px: FloatArray,
    y_px: FloatArray,
    saturated_above: float,
    found: FloatArray,
    explained: FloatArray,
    saturated: FloatArray,
) -> None:
    size, rings = images.shape[1], found.shape[1]
    sums, weights = np.zeros(rings + 1), np.zeros(rings + 1)
    pixels, bright = np.zeros(rings), np.zeros(rings)
    for i in range(len(images)):
        if np.isnan(x_px[i]) or np.isnan(y_px[i]):
            continue
        sums[:], weights[:], pixels[:], bright[:] = 0, 0, 0, 0
        total, count = 0.0, 0
        for row in range(size):
            for column in range(size):
                radius = np.hypot(column - x_px[i], row - y_px[i])
                ring = int(radius)
                if ring >= rings:
                    continue
                value, outer = images[i, row, column], radius - ring
                sums[ring] += (1 - outer) * value
                weights[ring] += 1 - outer
                sums[ring + 1] += outer * value
                weights[ring + 1] += outer
                pixels[ring] += 1
                bright[ring] += value >= saturated_above
                total += value
                count += 1
        for ring in range(rings):
            found[i, ring] = sums[ring] / weights[ring] if weights[ring] > 0 else np.nan
            if pixels[ring] > 0:
                saturated[i] = max(saturated[i], bright[ring] / pixels[ring])
        variance, rest = 0.0, 0.0
        for row in range(size):
            for column in range(size):
                radius = np.hypot(column - x_px[i], row - y_px[i])
                ring = int(radius)
                if ring >= rings:
                    continue
                outer = min(ring + 1, rings - 1)
                expected = found[i, ring] + (radius - ring) * (found[i, outer] - found[i, ring])
                variance += (images[i, row, column] - total / count) ** 2
                rest += (images[i, row, column] - expected) ** 2
        explained[i] = max(1 - rest / variance, 0.0) if variance > 0 else 0.0
