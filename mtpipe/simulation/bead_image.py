"""The image of a bead, as a function of its height and of the distance from its centre.

magtrack's optical model draws it: a plane wave through a sphere (refraction, absorption), through
an objective. It stands on square pixels itself, so that it is drawn with smaller ones, of which a
camera's pixel is the mean, and averaged over all directions; that takes 0.1 s for one height. It is
done every 100 nm, put on a fine grid by cubic splines (which changes the image by less than 0.1 %
of the background), and read off that grid for any position in 0.05 ms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray
from mtpipe.tracking.library import optics

PLANE_NM, FINE_NM, FINE_PX = 100.0, 5.0, 0.05
# Pixels of the drawn model per pixel of the camera, and angles over which its rings are averaged.
FINER, ANGLES = 3, 48
# The model cuts off what is brighter than 1, so the background stands low.
BACKGROUND = 0.02
# The last part of the radius over which the image goes over into the background.
FADING = 0.15


@dataclass(frozen=True)
class BeadOptics:
    """What a bead's image depends on.

    Attributes
    ----------
    radius_nm : of the bead. pixel_size_nm : in the plane of the bead.
    focus_nm : height above the focal plane of a bead whose z is 0.
    wavelength_nm : of the lamp. bead_index, medium_index : refractive indices.
    absorption_per_nm : of light's amplitude within the bead.
    reach_px : radius beyond which a bead leaves the background as it is.
    """

    radius_nm: float
    pixel_size_nm: float
    focus_nm: float = 5000.0
    wavelength_nm: float = 550.0
    bead_index: float = 1.59
    medium_index: float = 1.33
    absorption_per_nm: float = 0.0
    reach_px: int = 44


@dataclass(frozen=True, eq=False)
class BeadImage:
    """Brightness over the background's, on a grid of heights and radii.

    Attributes
    ----------
    low_nm : z of the first row. brightness : (heights, radii), `FINE_NM` and `FINE_PX` apart.
    """

    low_nm: float
    brightness: FloatArray
    reach_px: int

    @classmethod
    def of(cls, bead: BeadOptics, low_nm: float, high_nm: float) -> BeadImage:
        """The image for z from low to high, a little beyond included."""
        from scipy.interpolate import CubicSpline

        planes = np.arange(low_nm - 3 * PLANE_NM, high_nm + 4 * PLANE_NM, PLANE_NM)
        radii, drawn = _drawn(bead, planes)
        heights = np.arange(planes[0], planes[-1], FINE_NM)
        fine = np.arange(0, bead.reach_px + 2 * FINE_PX, FINE_PX)
        by_radius = CubicSpline(radii, drawn, axis=1)(fine)
        brightness = CubicSpline(planes, by_radius, axis=0)(heights)
        start = bead.reach_px * (1 - FADING)
        fade = np.clip((fine - start) / (bead.reach_px - start), 0, 1)
        brightness = 1 + (brightness - 1) * np.cos(np.pi / 2 * fade) ** 2
        return cls(float(planes[0]), np.ascontiguousarray(brightness), bead.reach_px)

    def add_to(
        self, frames: FloatArray, x_px: FloatArray, y_px: FloatArray, z_nm: FloatArray
    ) -> None:
        """Add a bead to frames that hold brightness over the background's.

        Parameters
        ----------
        frames : (n, height, width), changed.
        x_px, y_px, z_nm : (n, parts) where the bead is in equal parts of each frame.
        """
        _add(frames, x_px, y_px, z_nm - self.low_nm, self.brightness, self.reach_px)


def _drawn(bead: BeadOptics, planes_nm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Radii in px, and brightness over the background's, (planes, radii)."""
    from scipy.ndimage import map_coordinates, uniform_filter

    half = bead.reach_px + 8
    radii = np.arange(0, bead.reach_px + 2, 1 / FINER)
    angle = 2 * np.pi * (np.arange(ANGLES) + 0.5)[:, None] / ANGLES
    places = FINER * np.array([half + radii * np.sin(angle), half + radii * np.cos(angle)])
    brightness = np.empty((len(planes_nm), len(radii)))
    for i, z in enumerate(planes_nm):
        image = optics().simulate_beads(
            np.array([[0.0, 0.0, z + bead.focus_nm]]),
            nm_per_px=bead.pixel_size_nm / FINER,
            size_px=2 * half * FINER,
            radius_nm=bead.radius_nm,
            wavelength_nm=bead.wavelength_nm,
            n_sphere=bead.bead_index,
            n_medium=bead.medium_index,
            absorption_per_nm=bead.absorption_per_nm,
            background_level=BACKGROUND,
        )[:, :, 0]
        # the area of a whole pixel; an odd filter keeps the centre where it is
        image = uniform_filter(image, FINER, mode="nearest")
        brightness[i] = map_coordinates(image, places, order=3).mean(axis=0)
    # the model divides by the corner of its image, where rings may still be
    outer = (radii > bead.reach_px / 2) & (radii <= bead.reach_px)
    level = brightness[:, outer] @ radii[outer] / radii[outer].sum()
    return radii, brightness / level[:, None]


@compiled
def _add(
    frames: FloatArray,
    x_px: FloatArray,
    y_px: FloatArray,
    above_nm: FloatArray,
    brightness: FloatArray,
    reach: int,
) -> None:
    parts = x_px.shape[1]
    for i in range(len(frames)):
        for part in range(parts):
            x, y = x_px[i, part], y_px[i, part]
            place = min(max(above_nm[i, part] / FINE_NM, 0.0), len(brightness) - 1.001)
            plane = int(place)
            up = place - plane
            for row in range(max(int(y) - reach, 0), min(int(y) + reach + 2, frames.shape[1])):
                for column in range(
                    max(int(x) - reach, 0), min(int(x) + reach + 2, frames.shape[2])
                ):
                    radius = np.hypot(column - x, row - y)
                    if radius >= reach:
                        continue
                    ring = int(radius / FINE_PX)
                    out = radius / FINE_PX - ring
                    below = (1 - out) * brightness[plane, ring] + out * brightness[plane, ring + 1]
                    above = (1 - out) * brightness[plane + 1, ring] + out * (
                        brightness[plane + 1, ring + 1]
                    )
                    frames[i, row, column] += ((1 - up) * below + up * above - 1) / parts
