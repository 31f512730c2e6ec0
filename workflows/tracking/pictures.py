"""The rendered images of the study: one bead, its focus scan, and its look-up tables."""

from __future__ import annotations

import functools

import numpy as np

from mtpipe.simulation.bead_image import BeadImage, BeadOptics
from mtpipe.simulation.images import Sensor, draw
from mtpipe.tracking.lookup_table import LookUpTable

PIXEL_NM, RADIUS_NM = 100.0, 1400.0
LOW_NM, HIGH_NM = 0.0, 2500.0
# Heights asked for: as far from the table's ends as any method needs.
INNER_NM = (350.0, 2150.0)


def sensor(background_e: float = 5000.0) -> Sensor:
    """A camera that digitizes finely, so that light alone makes the noise."""
    return Sensor(background_e=background_e, bits=16, electrons_per_level=background_e / 10_000)


def signal_to_noise(camera: Sensor) -> float:
    """Mean over standard deviation of a pixel of the background in one frame."""
    return float(camera.background_e / np.hypot(np.sqrt(camera.background_e), camera.read_noise_e))


@functools.cache
def bead(radius_nm: float = RADIUS_NM) -> BeadImage:
    """The bead's image at all heights."""
    return BeadImage.of(BeadOptics(radius_nm, PIXEL_NM), LOW_NM, HIGH_NM)


def positions(count: int, seed: int, low_nm: float = INNER_NM[0], high_nm: float = INNER_NM[1]):
    """(count, 3) px, px, nm: anywhere within a pixel of the middle, at any height between."""
    random = np.random.default_rng(seed)
    xy = random.uniform(-1, 1, (count, 2))
    return np.column_stack([xy, random.uniform(low_nm, high_nm, count)])


def images(
    from_middle: np.ndarray,
    camera: Sensor,
    seed: int,
    size_px: int = 64,
    radius_nm: float = RADIUS_NM,
) -> np.ndarray:
    """Images of a bead at (n, 3) px and px from the middle of the image, and nm."""
    random = np.random.default_rng([seed, 1])
    middle = np.array([(size_px - 1) / 2, (size_px - 1) / 2, 0.0])
    return draw(bead(radius_nm), camera, from_middle + middle, (size_px, size_px), random)


@functools.cache
def table(
    method: str, step_nm: float = 50.0, size_px: int = 64, radius_nm: float = RADIUS_NM
) -> LookUpTable:
    """From a scan of eight images a step, each at another phase of the pixels."""
    heights = np.repeat(np.arange(LOW_NM, HIGH_NM + 1, step_nm), 8)
    xy = np.random.default_rng(99).uniform(-0.5, 0.5, (len(heights), 2))
    stack = images(np.column_stack([xy, heights]), sensor(), 98, size_px, radius_nm)
    return LookUpTable.build(
        stack,
        heights,
        bead="rendered",
        refractive_index_factor=1.0,
        pixel_size_nm=PIXEL_NM,
        stack="rendered scan",
        method=method,
    )
