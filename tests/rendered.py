"""Rendered bead images for the tests of tracking: made once, and the same for whoever asks."""

from __future__ import annotations

import functools
import tomllib

import numpy as np

from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.usual_errors import exact
from mtpipe.simulation.bead_image import BeadImage, BeadOptics
from mtpipe.simulation.images import Sensor, draw
from mtpipe.tracking.lookup_table import LookUpTable
from mtpipe.tracking.measured import DEFAULT_METHOD

PIXEL_NM, SIZE_PX = 100.0, 64
MIDDLE_PX = (SIZE_PX - 1) / 2
LOW_NM, HIGH_NM = 0.0, 1500.0
# A short tether, so that few heights have to be drawn.
SETUP = f"""\
schema = 1
[camera]
frame_rate_hz = 120.0
exposure_s = 0.008333333
pixel_size_nm = {PIXEL_NM}
[beads]
radius_nm = 1400.0
reference = ["ref1"]
[tether]
contour_length_nm = 1000.0
persistence_length_nm = 50.0
[buffer]
temperature_K = 298.15
viscosity_mPa_s = 0.89
[field]
direction = "x"
[model]
effects = ["wall_drag", "rotation_coupling", "tracking_noise"]
"""


@functools.cache
def bead() -> BeadImage:
    return BeadImage.of(BeadOptics(1400.0, PIXEL_NM), LOW_NM, HIGH_NM)


def images(positions, sensor=None, seed=0, image=None):
    """Images (n, 64, 64) of a bead at (n, 3) x, y in px and z in nm."""
    random = np.random.default_rng(seed)
    positions = np.atleast_2d(np.asarray(positions, dtype=float))
    return draw(image or bead(), sensor or Sensor(), positions, (SIZE_PX, SIZE_PX), random)


def anywhere(count, seed, low_nm=LOW_NM + 150, high_nm=HIGH_NM - 150):
    """Positions (count, 3) at any phase of the pixels and any height."""
    random = np.random.default_rng(seed)
    xy = MIDDLE_PX + random.uniform(-3, 3, (count, 2))
    return np.column_stack([xy, random.uniform(low_nm, high_nm, count)])


def scan(step_nm=50.0, repeats=5, seed=7, image=None, low_nm=LOW_NM, high_nm=HIGH_NM):
    """Images of a focus scan and their heights."""
    random = np.random.default_rng(seed)
    heights = np.repeat(np.arange(low_nm, high_nm + step_nm / 2, step_nm), repeats)
    xy = MIDDLE_PX + random.uniform(-0.5, 0.5, (len(heights), 2))
    return images(np.column_stack([xy, heights]), seed=seed, image=image), heights


@functools.cache
def table(method=DEFAULT_METHOD, step_nm=50.0) -> LookUpTable:
    return build(*scan(step_nm), method=method)


def build(
    stack, heights_nm, factor=1.0, method=DEFAULT_METHOD, saturated_above=None
) -> LookUpTable:
    return LookUpTable.build(
        stack,
        heights_nm,
        bead="b1",
        refractive_index_factor=factor,
        pixel_size_nm=PIXEL_NM,
        stack="scan.tif",
        method=method,
        saturated_above=saturated_above,
    )


def setup(exposure_s=1 / 120) -> Setup:
    content = tomllib.loads(SETUP)
    content["camera"]["exposure_s"] = exposure_s
    return parse_setup(exact(content))
