"""Positions of one bead in its region images: x and y, the height, and whether to believe them.

magtrack finds x and y (`mtpipe.tracking.centres`), the radial profile about them is compared with a
look-up table (`mtpipe.tracking.matching`). The method `magtrack` is that library's own way
throughout, profile and height included. An image in which the bead cannot be measured is lost, with
the reason:

- no bead: rings about the position explain no more of the image than they would of noise (F-test);
- left the region: the position is more than a quarter of the region from its middle, where rings
  are cut off;
- saturated: more than half of the pixels of a ring are, so that its mean is a bound and no
  measurement;
- correlation too low: the table explains less than half of the profile's variance;
- outside the look-up table: beyond its first or last plane. x and y remain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.types import FloatArray
from mtpipe.tracking.library import magtrack
from mtpipe.tracking.matching import match
from mtpipe.tracking.measured import (
    DEFAULT_METHOD,
    OUTSIDE,
    UNLIKE,
    IntArray,
    checked_images,
    measure,
)

if TYPE_CHECKING:
    from mtpipe.tracking.lookup_table import LookUpTable


@dataclass(frozen=True, eq=False)
class Positions:
    """Positions of one bead in n region images.

    Attributes
    ----------
    x_px, y_px : (n,) centre in the region's own pixels, 0 the centre of the first; NaN where lost.
    z_nm : (n,) height in the look-up table; NaN without one or where lost.
    quality : (n,) from 0 to 1: correlation with the table; without one the share of the image's
        variance that is circular about the position.
    lost : (n,) 0, or a code of `LOST_REASONS`.
    """

    x_px: FloatArray
    y_px: FloatArray
    z_nm: FloatArray
    quality: FloatArray
    lost: IntArray


def locate(
    images: NDArray[Any],
    *,
    method: str = DEFAULT_METHOD,
    table: LookUpTable | None = None,
    saturated_above: float | None = None,
) -> Positions:
    """Find a bead in images of its region.

    Parameters
    ----------
    images : (n, size, size) grey levels of any type; rows are y, columns x.
    method : one of `METHODS`.
    table : of this bead; None leaves z empty.
    saturated_above : grey level from which on a pixel is saturated; None: it is not known.

    Raises
    ------
    RecordingError : images, method and table do not fit together.
    """
    images = checked_images(images)
    if table is not None:
        table.check_region(images.shape[1])
        if (table.method == "magtrack") != (method == "magtrack"):
            raise RecordingError(
                f"a look-up table made with the method {table.method} cannot be used with {method}",
                mend="Make the table with the method you track with.",
            )
    limit = np.inf if saturated_above is None else saturated_above
    found = measure(images, method, limit)
    lost = found.lost.copy()
    height, quality = np.full(len(images), np.nan), found.circular.copy()
    good = np.flatnonzero(lost == 0)
    if table is not None and len(good):
        if method == "magtrack":
            height[good], quality[good] = _magtrack_height(found.profiles[good], table)
        else:
            height[good], quality[good] = match(found.profiles[good], table.z_nm, table.planes)
        beyond, unlike = np.isnan(height), quality < np.sqrt(0.5)
        lost[(lost == 0) & unlike] = UNLIKE
        lost[(lost == 0) & beyond] = OUTSIDE
        height[lost != 0] = np.nan
    hidden = (lost != 0) & (lost != OUTSIDE)
    return Positions(
        x_px=np.where(hidden, np.nan, found.x_px),
        y_px=np.where(hidden, np.nan, found.y_px),
        z_nm=height,
        quality=np.clip(np.nan_to_num(quality), 0, 1),
        lost=lost,
    )


def _magtrack_height(profiles: FloatArray, table: LookUpTable) -> tuple[FloatArray, FloatArray]:
    """Heights as magtrack finds them, and the correlation with the nearest plane."""
    library, seen = magtrack(), profiles.T
    with np.errstate(divide="ignore", invalid="ignore"):
        known = np.vstack([table.z_nm, table.profiles.T])
        height = library.lookup_z(seen, known)
        correlation = library.pearson(known[2:], seen[1:]).max(axis=1)
    return np.asarray(height), np.asarray(correlation)
