"""Centres and radial profiles of bead images, and which of them show no bead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.types import FloatArray
from mtpipe.tracking.centres import CENTRES, centres
from mtpipe.tracking.library import from_device, magtrack, on_device, stack_of
from mtpipe.tracking.matching import ring_count

IntArray = NDArray[np.int64]
METHODS: tuple[str, ...] = (*CENTRES, "magtrack")
# The most accurate of them, and no slower than the next: docs/tracking-accuracy.md.
DEFAULT_METHOD: str = "auto_conv_multiline"
NO_BEAD, LEFT, SATURATED, UNLIKE, OUTSIDE = 1, 2, 3, 4, 5
LOST_REASONS: dict[int, str] = {
    NO_BEAD: "no bead",
    LEFT: "left the region",
    SATURATED: "saturated",
    UNLIKE: "correlation too low",
    OUTSIDE: "outside the look-up table",
}
# Chance that an image of nothing but noise passes for a bead.
FALSE_BEAD = 1e-6
MIN_SIZE_PX = 16
# Images worked on at once: what they need fits into a processor's cache.
BLOCK = 64


@dataclass(frozen=True, eq=False)
class Measured:
    """What an image tells without a look-up table.

    Attributes
    ----------
    x_px, y_px, lost : as in `Positions`, but found also where lost.
    profiles : (n, rings) mean brightness; NaN where there is no centre.
    circular : (n,) share of the variance within the rings that the profile explains.
    noise : (n,) standard deviation of the components of the normalized profile, from the rest of
        that variance.
    """

    x_px: FloatArray
    y_px: FloatArray
    lost: IntArray
    profiles: FloatArray
    circular: FloatArray
    noise: FloatArray


def checked_images(images: NDArray[Any]) -> NDArray[Any]:
    """The images if they can be tracked.

    Raises
    ------
    RecordingError : they are not square, or too small.
    """
    images = np.asarray(images)
    if images.ndim != 3 or images.shape[1] != images.shape[2] or images.shape[1] < MIN_SIZE_PX:
        shape = " x ".join(map(str, images.shape))
        raise RecordingError(
            f"bead images are needed as a stack of squares of at least {MIN_SIZE_PX} pixels, "
            f"not {shape}"
        )
    return images


def measure(images: NDArray[Any], method: str, saturated_above: float) -> Measured:
    """Centres and profiles of images (n, size, size), and which of them show a bead."""
    if method not in METHODS:
        raise RecordingError(f"there is no method {method!r}", mend=f"Known: {', '.join(METHODS)}.")
    parts = [
        _measure_block(np.asarray(images[i : i + BLOCK], dtype=float), method, saturated_above)
        for i in range(0, max(len(images), 1), BLOCK)
    ]
    return Measured(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _measure_block(
    images: FloatArray, method: str, saturated_above: float
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray, FloatArray, FloatArray]:
    from mtpipe.tracking.rings import profiles

    n, size = len(images), images.shape[1]
    x, y = np.full((2, n), np.nan)
    # a flat or broken image has no centre of mass, and magtrack cannot go on from none
    lit = np.isfinite(images).all(axis=(1, 2)) & (np.ptp(images, axis=(1, 2)) > 0)
    if lit.any():
        way = "auto_conv_multiline" if method == "magtrack" else method
        x[lit], y[lit] = centres(images[lit], way)
    found, circular, saturated = profiles(images, x, y, saturated_above)
    rings = ring_count(size)
    pixels = np.pi * rings**2
    circular = np.nan_to_num(circular)
    unexplained = np.maximum(1 - circular, 1e-12)
    # ratio that a profile of these rings exceeds in one of a million images of noise alone
    ratio = fdtri(rings - 1, pixels - rings, 1 - FALSE_BEAD) * (rings - 1) / (pixels - rings)
    middle = (size - 1) / 2
    lost = np.zeros(n, dtype=np.int64)
    lost[saturated > 0.5] = SATURATED
    with np.errstate(invalid="ignore"):
        lost[np.maximum(np.abs(x - middle), np.abs(y - middle)) > size / 4] = LEFT
    lost[~(circular / unexplained > ratio)] = NO_BEAD
    lost[np.isnan(x) | np.isnan(y) | np.isnan(found).any(axis=1)] = NO_BEAD
    noise = np.sqrt(unexplained / np.maximum(circular, 1e-12) / pixels)
    if method == "magtrack" and lit.any():
        found[lit] = _magtrack_profiles(images[lit], x[lit], y[lit])
    return x, y, lost, found, circular, noise


def _magtrack_profiles(images: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    with np.errstate(all="ignore"):
        return from_device(
            magtrack().radial_profile(stack_of(images), on_device(x), on_device(y))
        ).T
