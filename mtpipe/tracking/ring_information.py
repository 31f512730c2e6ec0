"""What the rings of a bead tell of its place, and how much of it a region of some size uses.

A ring of radius r and width dr whose brightness changes by I' per pixel, on pixels of variance v,
adds π r dr I'²/v to the Fisher information on x and as much on y. magtrack's centre
(`auto_conv_multiline`) uses the part of it near the axes: the mean of the lines within a twentieth
of the region about the centre, under a Gaussian with a standard deviation of a sixth of the region.
With a slope a' of that mean and weights w (the square of the Gaussian, as the line is multiplied
with its own mirror image) the error is Σ w a' n / Σ w a'² in noise n, and its variance
Σ w² a'² v / (lines (Σ w a'²)²). A larger region has more lines and a broader Gaussian, until the
lines are so far apart that rings bend between them, or there are no more rings.

Slopes are squared as the product of what two halves of a ring say, each made of every other of
eight sectors: noise and dust are not the same in both halves and add nothing on average, and a
tilted lamp cancels within each.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray
from mtpipe.tracking.measured import MIN_SIZE_PX
from mtpipe.tracking.precision import PixelNoise

SECTORS = 8
# Rings are this far apart: with whole pixels the finest rings that a camera sees are smoothed away.
RING_PX = 0.5
# magtrack's own numbers, over the side of a region: lines, and the deviation of its Gaussian
# window, which enters the information squared.
LINES, WINDOW = 0.1, 1 / 6
# What a still larger region would gain in precision is no longer worth its time.
WORTH = 0.02


@dataclass(frozen=True, eq=False)
class RingInformation:
    """The rings of a bead, or of several alike.

    Attributes
    ----------
    halves : (n, 2, rings) mean brightness of both halves of each ring in n images, grey levels;
        the first ring is the centre, the others stand `RING_PX` apart.
    variance : (rings,) of a pixel.
    """

    halves: FloatArray
    variance: FloatArray

    @classmethod
    def of(
        cls, images: FloatArray, x_px: FloatArray, y_px: FloatArray, noise: PixelNoise
    ) -> RingInformation:
        """What images (n, size, size) with a bead at (n,) places near their middle show.

        Rings go as far as they are whole in every image.
        """
        last = images.shape[1] - 1
        reach = float(np.min([x_px, y_px, last - x_px, last - y_px]))
        halves = np.zeros((len(images), 2, int(reach / RING_PX) + 1))
        _halves(np.asarray(images, dtype=float), x_px, y_px, halves)
        return cls(halves, noise.variance(halves.mean(axis=(0, 1))))

    @cached_property
    def _slopes(self) -> FloatArray:
        """(n, 2, rings) grey levels per pixel."""
        return np.asarray(CubicSpline(self.radii_px, self.halves, axis=2)(self.radii_px, 1))

    @cached_property
    def radii_px(self) -> FloatArray:
        """(rings,)."""
        return RING_PX * np.arange(self.halves.shape[2], dtype=np.float64)

    @cached_property
    def by_ring(self) -> FloatArray:
        """(n, rings) Fisher information on x, px⁻²; scatters about 0 where there are no rings."""
        square = np.prod(self._slopes, axis=1)
        return np.asarray(np.pi * self.radii_px * RING_PX * square / self.variance)

    def share(self, size_px: int) -> float:
        """Share of the rings' information that is used in a region of this side."""
        total = self.by_ring.sum(axis=1)
        if np.median(total) <= 0:
            return 0.0
        used = self._variances_px2(size_px) ** -1
        return float(np.clip(np.median(used) / np.median(total), 0, 1))

    def precision_px(self, size_px: int) -> float:
        """Standard deviation of x in a region of this side, by magtrack's lines; inf: no rings.

        Of images at different heights, as of a focus scan, it is the median.
        """
        return float(np.sqrt(np.median(self._variances_px2(size_px))))

    def _variances_px2(self, size_px: int) -> FloatArray:
        """(n,) variance of x in each image; inf where there are no rings."""
        x = np.arange(1, size_px // 2 + 1, dtype=float)
        beside = int(size_px * LINES // 2)
        y = np.arange(-beside, beside + 1, dtype=float)
        r = np.minimum(np.hypot(x, y[:, None]), self.radii_px[-1])
        ring = np.minimum((r / RING_PX).astype(int), len(self.radii_px) - 2)
        outer = r / RING_PX - ring
        along = (1 - outer) * self._slopes[:, :, ring] + outer * self._slopes[:, :, ring + 1]
        square = np.prod(np.mean(along * (x / r), axis=2), axis=1)
        weight = np.exp(-((x / (size_px * WINDOW)) ** 2))
        variance = np.interp(x, self.radii_px, self.variance) / len(y)
        # both sides of the centre, in the sum of the signal and in that of the noise
        signal = 2 * square @ weight
        error = 2 * square @ (weight**2 * variance)
        rings = (signal > 0) & (error > 0)
        found: FloatArray = np.full(len(signal), np.inf)
        found[rings] = error[rings] / signal[rings] ** 2
        return found

    def size_px(self) -> int:
        """The smallest side, odd, that no larger one within the rings betters by `WORTH`."""
        largest = max(int(2 * self.radii_px[-1]) // 2 * 2 + 1, MIN_SIZE_PX + 1)
        sizes = np.arange(MIN_SIZE_PX + 1, largest + 1, 2)
        precision = np.array([self.precision_px(int(size)) for size in sizes])
        return int(sizes[np.argmax(precision <= (1 + WORTH) * precision.min())])


@compiled
def _halves(images: FloatArray, x_px: FloatArray, y_px: FloatArray, halves: FloatArray) -> None:
    """Fill in the mean brightness of rings; a pixel between two counts for both."""
    rings, size = halves.shape[2], images.shape[1]
    weights = np.zeros((2, rings + 1))
    sums = np.zeros((2, rings + 1))
    for i in range(len(images)):
        weights[:], sums[:] = 0, 0
        for row in range(size):
            for column in range(size):
                dx, dy = column - x_px[i], row - y_px[i]
                place = np.hypot(dx, dy) / RING_PX
                ring = int(place)
                if ring >= rings:
                    continue
                half = int((np.arctan2(dy, dx) / (2 * np.pi) + 1) * SECTORS) % 2
                outer = place - ring
                sums[half, ring] += (1 - outer) * images[i, row, column]
                weights[half, ring] += 1 - outer
                sums[half, ring + 1] += outer * images[i, row, column]
                weights[half, ring + 1] += outer
        for half in range(2):
            # from the outermost ring on, as sectors hold no pixel very near to the centre
            for ring in range(rings - 1, -1, -1):
                if weights[half, ring] > 0:
                    halves[i, half, ring] = sums[half, ring] / weights[half, ring]
                else:
                    halves[i, half, ring] = halves[i, half, min(ring + 1, rings - 1)]
