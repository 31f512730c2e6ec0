"""How precisely a bead's position can be told from its images: the tracker's own noise.

Light comes as photons and a sensor adds noise of its own: the variance of a pixel rises in
proportion to its mean, from what it is in the dark (photon transfer, Janesick 2007). Both numbers
are read from the images: the bead's image is smooth on the scale of a pixel (the objective cuts off
finer detail) and noise is not, so that a sixth difference along both axes leaves noise alone.

Noise of that size is then added once more to images as they are, and they are tracked again,
several times. The scatter about each image's mean is the scatter that the noise there is makes, as
long as the tracker answers to noise in proportion; unlike a bound (Cramér-Rao) it holds for the
tracker in use. What pixels, lamp and look-up table do to positions is not in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.stats import chi2

from mtpipe.ground.types import FloatArray
from mtpipe.tracking.measured import DEFAULT_METHOD, checked_images
from mtpipe.tracking.positions import locate

if TYPE_CHECKING:
    from mtpipe.tracking.lookup_table import LookUpTable

# Sixth difference: of a ring pattern with a period of four pixels along the diagonal it leaves
# 0.2 %, of white noise all.
DIFFERENCE = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0])
BINS = 12
# Draws, spread over the images: a standard deviation to 4 %.
DRAWS, IMAGES = 384, 48


@dataclass(frozen=True)
class PixelNoise:
    """Variance of a pixel in grey levels squared: `dark` + `per_level` times its mean.

    The mean is counted from grey level 0, so that `dark` takes in the camera's offset and may be
    negative; the variance of a pixel may not.
    """

    dark: float
    per_level: float
    least: float

    def variance(self, mean: FloatArray) -> FloatArray:
        """Variance at mean grey levels."""
        return np.maximum(self.dark + self.per_level * mean, self.least)


def pixel_noise(images: NDArray[Any]) -> PixelNoise:
    """Photon and read noise of images (n, size, size), digitization included."""
    squares, means = [], []
    for image in np.asarray(images, dtype=float):
        fine, smooth = image, image
        for axis in (0, 1):
            fine = correlate1d(fine, DIFFERENCE, axis=axis)
            smooth = correlate1d(smooth, DIFFERENCE**2 / np.sum(DIFFERENCE**2), axis=axis)
        inner = slice(len(DIFFERENCE) // 2, -(len(DIFFERENCE) // 2))
        squares.append(fine[inner, inner].ravel() ** 2 / np.sum(DIFFERENCE**2) ** 2)
        means.append(smooth[inner, inner].ravel())
    square, mean = np.concatenate(squares), np.concatenate(means)
    order = np.array_split(np.argsort(mean), BINS)
    level = np.array([mean[i].mean() for i in order])
    # the median, because the few pixels where the image itself is sharp do not change it
    variance = np.array([np.median(square[i]) for i in order]) / chi2.median(1)
    # a variance is known in proportion to itself, so the larger ones count less
    weight = 1 / np.maximum(variance, 1e-3 * variance.max() + 1e-12)
    slope, start = np.polyfit(level, variance, 1, w=weight) if np.ptp(level) > 0 else (0.0, 0.0)
    if slope <= 0:
        slope, start = 0.0, float(variance.mean())
    return PixelNoise(float(start), float(slope), float(variance.min()) / 2)


def precision_nm(
    images: NDArray[Any],
    pixel_size_nm: float,
    method: str = DEFAULT_METHOD,
    table: LookUpTable | None = None,
    *,
    seed: int = 0,
) -> FloatArray:
    """Standard deviations of x, y, z that photon and read noise give each position.

    Parameters
    ----------
    images : (n, size, size) of one bead, n >= 1; about 50 of them, spread over the stack, are used.
    method, table : as `mtpipe.tracking.positions.locate`.
    seed : of the noise that is added.

    Returns
    -------
    (3,) nm; NaN for z without a table, and for what could not be measured.
    """
    images = checked_images(images)
    chosen = images[np.unique(np.linspace(0, len(images) - 1, IMAGES).astype(int))].astype(float)
    chosen = chosen[locate(chosen, method=method, table=table).lost == 0]
    if not len(chosen):
        return np.full(3, np.nan)
    deviation = np.sqrt(pixel_noise(chosen).variance(chosen))
    random = np.random.default_rng(seed)
    scale = np.array([pixel_size_nm, pixel_size_nm, 1.0])
    draws = np.empty((max(-(-DRAWS // len(chosen)), 2), len(chosen), 3))
    for draw in draws:
        noisy = chosen + deviation * random.normal(size=chosen.shape)
        found = locate(noisy, method=method, table=table)
        draw[:] = np.stack([found.x_px, found.y_px, found.z_nm], axis=1)
        draw[found.lost != 0] = np.nan
    # noise may also shift an image's mean, which is no scatter
    counts = np.sum(np.isfinite(draws), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.nansum(draws, axis=0) / counts
        square = np.nansum((draws - mean) ** 2, axis=(0, 1)) / np.sum(
            np.maximum(counts - 1, 0), axis=0
        )
    return np.asarray(scale * np.sqrt(square))
