"""How large the regions of beads that are found are: as large as their rings tell of their place.

The beads with most room show how far rings go (`mtpipe.tracking.ring_information`), and every bead
gets a region for that, and room to move. It ends at the border of the image and halfway to the
next bead, whose rings would be taken for its own beyond.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.stats import median_abs_deviation

from mtpipe.ground.types import FloatArray
from mtpipe.tracking.find_beads import FoundBeads, Region
from mtpipe.tracking.follow import corner, cut
from mtpipe.tracking.measured import MIN_SIZE_PX
from mtpipe.tracking.positions import locate
from mtpipe.tracking.precision import pixel_noise
from mtpipe.tracking.ring_information import RingInformation

# Reach of the search for rings, in radii of a bead; most beads and images that are used.
REACH_RADII = 8
BEADS, IMAGES = 4, 16
# Room for motion to each side of a bead, in standard deviations.
MOTION = 3.0


def sized(
    found: FoundBeads, frames: FloatArray, size_px: int | None
) -> tuple[FoundBeads, RingInformation | None]:
    """Beads with regions as large as is worth while, and what was learned of their rings.

    Parameters
    ----------
    found : beads in `frames`, (n, height, width), with regions in which they can be located.
    size_px : side of all regions, which then stay as they are; None: as the rings have it.
    """
    if not found.regions:
        return found, None
    frames = frames[np.isfinite(frames).all(axis=(1, 2))]
    places = [_places(region, frames) for region in found.regions]
    bounds = [_bound_px(region, found, frames.shape[1:]) for region in found.regions]
    reach = min(max(bounds), math.ceil(REACH_RADII * found.radius_px))
    roomy = [place for place, bound in zip(places, bounds, strict=True) if bound >= reach]
    rings = _rings(frames, roomy[:BEADS], reach)
    if size_px is not None or rings is None:
        return found, rings
    wanted = rings.size_px()
    sizes = [
        min(_with_room(wanted, place), 2 * bound + 1)
        for place, bound in zip(places, bounds, strict=True)
    ]
    regions = tuple(
        replace(region, size_px=size) for region, size in zip(found.regions, sizes, strict=True)
    )
    return replace(found, regions=regions), rings


def _bound_px(region: Region, found: FoundBeads, shape: tuple[int, ...]) -> int:
    """Half the largest region: to the border, or halfway to the next bead."""
    x, y = region.x_px, region.y_px
    border = min(x, y, shape[1] - 1 - x, shape[0] - 1 - y)
    others = [(r.x_px, r.y_px) for r in found.regions] + [(r.x_px, r.y_px) for r in found.refused]
    halfway = [d / 2 for other in others if (d := math.dist(other, (x, y))) > 0]
    return max(int(min([border, *halfway])), MIN_SIZE_PX // 2)


def _places(region: Region, frames: FloatArray) -> FloatArray:
    """(n, 2) x and y of a bead in the image; NaN where it was not found."""
    row, column = corner(region, (frames.shape[1], frames.shape[2]))
    seen = locate(cut(frames, region))
    return np.column_stack([seen.x_px + column, seen.y_px + row])


def _rings(frames: FloatArray, places: list[FloatArray], reach_px: int) -> RingInformation | None:
    """Rings of beads at (n, 2) places in the frames; None if none are seen."""
    shape = (frames.shape[1], frames.shape[2])
    chosen = np.unique(np.linspace(0, len(frames) - 1, IMAGES).astype(int))
    images, middles = [], []
    for k in chosen:
        for x, y in (place[k] for place in places if np.isfinite(place[k]).all()):
            about = Region("", float(x), float(y), 2 * reach_px + 1)
            row, column = corner(about, shape)
            images.append(cut(frames[k : k + 1], about)[0])
            middles.append((x - column, y - row))
    if not images:
        return None
    stack = np.array(images, dtype=float)
    x_px, y_px = np.array(middles).T
    rings = RingInformation.of(stack, x_px, y_px, pixel_noise(stack))
    return rings if np.median(rings.by_ring.sum(axis=1)) > 0 else None


def _with_room(size_px: int, places: FloatArray) -> int:
    """A side that leaves room to move; a bead is lost a quarter of a region from its middle."""
    seen = places[np.isfinite(places).all(axis=1)]
    if not len(seen):
        return size_px
    # of a focus scan some images are in focus, and the places there mean nothing
    motion = float(np.max(median_abs_deviation(seen, axis=0, scale="normal")))
    room = math.ceil(MOTION * motion)
    return max(size_px + 2 * room, 4 * room + 1)
