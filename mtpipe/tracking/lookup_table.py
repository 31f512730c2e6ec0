"""Look-up tables: the radial profiles of one bead at known heights, from a focus scan.

The scan moves the focus by known steps while the bead stays on the surface. Moving the objective
is not moving the bead: between oil objective and water the bead appears to move by the focus
position times a factor near the ratio of the refractive indices, 1.33/1.52 = 0.88 for small angles
and less for a high aperture (Hell et al. 1993; laboratories use 0.80 to 0.88). The factor is stated
when the table is built and is in the table's heights from then on; it is negative where the stage
counts down when the bead would have to move up.

A table can tell heights apart only where profiles differ by more than their noise. A scan that
crosses focus shows the same rings on both sides of it: such planes are found and only the longest
range without them is kept.
"""

from __future__ import annotations

import io
import json
from collections import Counter
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat
from scipy.interpolate import CubicSpline

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.files import write_atomically
from mtpipe.ground.notice import Notice
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.bounded import BoundedReader, check_archive
from mtpipe.tracking.information import confused_with, longest_without
from mtpipe.tracking.matching import normalized, ring_count
from mtpipe.tracking.measured import DEFAULT_METHOD, LOST_REASONS, METHODS, checked_images, measure

SCHEMA = "mtpipe.lookup_table/1"
# magtrack's own method fits a parabola through seven planes; fewer say little of a range anyway.
MIN_PLANES = 7
# Heights that agree to this many digits of a nm belong to one plane.
PLANE_DIGITS = 2


@dataclass(frozen=True, eq=False)
class LookUpTable:
    """Radial profiles of one bead at known heights.

    Attributes
    ----------
    z_nm : (m,) heights, increasing; focus positions times `refractive_index_factor`.
    profiles : (m, rings) mean brightness on rings one pixel apart, grey levels.
    noise : (m,) what the noise of one image does to each component of a normalized profile.
    bead : whose profiles they are. region_size_px : side of the images it was built from.
    pixel_size_nm : None where it was not stated.
    method : by which positions were found; profiles of `magtrack` are counted otherwise.
    scanned_nm : lowest and highest height of the scan, of which `z_nm` may be a part.
    source : name of the stack. made : date. notices : what to know, of `build` and not saved.
    """

    z_nm: FloatArray
    profiles: FloatArray
    noise: FloatArray
    bead: str
    region_size_px: int
    pixel_size_nm: float | None
    method: str
    refractive_index_factor: float
    scanned_nm: tuple[float, float]
    source: str
    made: str
    notices: tuple[Notice, ...] = ()

    @cached_property
    def planes(self) -> CubicSpline:
        """Normalized profiles (rings,) as a function of the height in nm."""
        return CubicSpline(self.z_nm, normalized(self.profiles))

    @property
    def precision_nm(self) -> FloatArray:
        """(m,) what the scan's noise would make the error of one height, at most.

        Noise is all of an image that is not circular, so that dust and neighbours count as well.
        """
        return np.asarray(self.noise / np.linalg.norm(self.planes(self.z_nm, 1), axis=1))

    @classmethod
    def build(
        cls,
        images: np.ndarray,
        z_nm: FloatArray,
        *,
        bead: str,
        refractive_index_factor: float,
        pixel_size_nm: float | None,
        stack: str,
        method: str = DEFAULT_METHOD,
        saturated_above: float | None = None,
    ) -> LookUpTable:
        """Make a table from a focus scan; images of the same focus are averaged.

        Parameters
        ----------
        images : (n, size, size) grey levels, the bead near the middle.
        z_nm : (n,) focus position of each image, before the factor.
        refractive_index_factor : height per focus position; see the module.
        stack : name of the scan.
        saturated_above : as `mtpipe.tracking.positions.locate`; saturated images are left out.

        Raises
        ------
        RecordingError : the scan does not tell heights apart; the message says why.
        """
        images = checked_images(images)
        heights = np.asarray(z_nm, dtype=float) * refractive_index_factor
        _check_heights(heights, len(images), refractive_index_factor, stack)
        found = measure(images, method, np.inf if saturated_above is None else saturated_above)
        good = found.lost == 0
        counts = Counter(LOST_REASONS[code] for code in found.lost[~good].tolist())
        lost = ", ".join(f"{reason} {n}" for reason, n in counts.most_common())
        labels = heights.round(PLANE_DIGITS)
        planes = np.unique(labels[good])
        if len(planes) < MIN_PLANES:
            raise RecordingError(
                f"the bead was found at {len(planes)} heights of {len(np.unique(labels))}, and a "
                f"look-up table needs {MIN_PLANES}" + (f" (images lost: {lost})" if lost else ""),
                where=f"{stack}, bead {bead}",
                mend="Take a scan of more steps with the bead in the middle of its region.",
            )
        groups = [good & (labels == plane) for plane in planes]
        profiles = np.array([found.profiles[group].mean(axis=0) for group in groups])
        noise = np.array([np.sqrt(np.mean(found.noise[group] ** 2)) for group in groups])
        table = cls(
            z_nm=planes,
            profiles=profiles,
            noise=noise,
            bead=bead,
            region_size_px=images.shape[1],
            pixel_size_nm=pixel_size_nm,
            method=method,
            refractive_index_factor=refractive_index_factor,
            scanned_nm=(float(heights.min()), float(heights.max())),
            source=stack,
            made=f"{datetime.now(UTC):%Y-%m-%d}",
        )
        return _usable(table, lost)

    def save(self, path: Path | str) -> None:
        """Write the table whole or not at all, as .npz: its arrays, and the rest as JSON."""
        rest = {
            "schema": SCHEMA,
            "bead": self.bead,
            "region_size_px": self.region_size_px,
            "pixel_size_nm": self.pixel_size_nm,
            "method": self.method,
            "refractive_index_factor": self.refractive_index_factor,
            "scanned_nm": self.scanned_nm,
            "source": self.source,
            "made": self.made,
        }
        stream = io.BytesIO()
        np.savez_compressed(
            stream,
            z_nm=self.z_nm,
            profiles=self.profiles,
            noise=self.noise,
            metadata=np.array(json.dumps(rest)),
        )
        write_atomically(Path(path), stream.getvalue())

    @classmethod
    def load(cls, path: Path | str) -> LookUpTable:
        """Read a table that `save` wrote.

        Raises
        ------
        RecordingError : there is none, or it is not whole.
        """
        path = Path(path)
        try:
            with BoundedReader(path) as stream, np.load(stream, allow_pickle=False) as file:
                check_archive(file.zip, path.stat().st_size, str(path))
                schema = json.loads(str(file["metadata"]))["schema"]
                if schema != SCHEMA:
                    raise RecordingError(
                        "this look-up table was written by another version of mtpipe",
                        where=str(path),
                        mend="Make it again with `mtpipe lut`.",
                    )
                rest = _Metadata.model_validate_json(str(file["metadata"]))
                z_nm, profiles, noise = (np.asarray(file[name], float) for name in _ARRAYS)
                table = cls(z_nm, profiles, noise, **rest.model_dump())
                table._check()
                return table
        except FileNotFoundError:
            raise RecordingError("there is no such look-up table", where=str(path)) from None
        except PermissionError as error:
            raise RecordingError(f"cannot be read ({error.strerror})", where=str(path)) from None
        except RecordingError:
            raise
        except Exception:  # numpy and zipfile raise anything on a damaged file
            raise RecordingError(
                "this is not a look-up table of mtpipe, or it is damaged",
                where=str(path),
                mend="Make one from a focus scan with `mtpipe lut`.",
            ) from None

    def _check(self) -> None:
        """Raise ValueError if the arrays do not fit together or are no table."""
        planes, rings = self.profiles.shape
        if self.z_nm.shape != (planes,) or self.noise.shape != (planes,):
            raise ValueError("heights, profiles and noise differ in length")
        if planes < MIN_PLANES or rings != ring_count(self.region_size_px):
            raise ValueError("there are too few heights, or other rings than the region has")
        if not np.all(np.diff(self.z_nm) > 0) or not np.all(self.noise >= 0):
            raise ValueError("heights do not increase, or noise is below zero")
        if not np.isfinite(self.planes.c).all() or not np.isfinite(self.noise).all():
            raise ValueError("profiles are no numbers")

    def check_region(self, size_px: int) -> None:
        """Raise RecordingError if images of this side cannot be compared with the table."""
        if ring_count(size_px) != self.profiles.shape[1]:
            raise RecordingError(
                f"regions of {size_px} pixels cannot be compared with the look-up table of bead "
                f"{self.bead}, which was built from {self.region_size_px} pixels",
                mend="Track with regions of the table's size, or build the table again.",
            )


_ARRAYS = ("z_nm", "profiles", "noise")


class _Metadata(BaseModel):
    """What stands in a file beside its arrays."""

    model_config = ConfigDict(strict=True)

    bead: str
    region_size_px: int = Field(gt=0)
    pixel_size_nm: FiniteFloat | None = Field(gt=0)
    method: Literal[METHODS]  # type: ignore[valid-type]
    refractive_index_factor: FiniteFloat
    scanned_nm: tuple[FiniteFloat, FiniteFloat]
    source: str
    made: str


def _check_heights(heights: FloatArray, images: int, factor: float, stack: str) -> None:
    if not 0.3 < abs(factor) < 3:
        raise RecordingError(
            f"a refractive-index factor of {factor:g} cannot be: it is near 0.88 for an oil "
            "objective into water, 1 without refraction"
        )
    if heights.shape != (images,):
        raise RecordingError(
            f"{heights.size} focus positions do not fit {images} images", where=stack
        )
    if not np.all(np.isfinite(heights)):
        raise RecordingError("a focus position of the scan is not a number", where=stack)


def _usable(table: LookUpTable, lost: str) -> LookUpTable:
    """The table's longest range in which every profile has one height, with what to know of it."""
    where = f"{table.source}, bead {table.bead}"
    confused, unresolved = confused_with(normalized(table.profiles), table.noise)
    if unresolved.all():
        raise RecordingError(
            "the profiles of the scan do not differ by more than their noise, so they tell "
            "nothing of the height",
            where=where,
            mend="Scan over more than a micrometre beside the focus.",
        )
    first, last = longest_without(confused)
    if last - first < MIN_PLANES:
        raise RecordingError(
            "the profiles of the scan come back at other heights: no range of "
            f"{MIN_PLANES} planes tells heights apart",
            where=where,
            mend="Scan on one side of the focus.",
        )
    notices = []
    if lost:
        said = f"Images of the scan that were left out, as the bead is lost in them: {lost}."
        notices.append(Notice("scan_images_lost", "caution", said, bead=table.bead))
    low, high = table.z_nm[first], table.z_nm[last - 1]
    if last - first < len(table.z_nm):
        said = (
            f"The scan shows the same profiles at different heights, as on both sides of the "
            f"focus. Of its {table.scanned_nm[0]:.0f} to {table.scanned_nm[1]:.0f} nm the "
            f"look-up table keeps {low:.0f} to {high:.0f} nm; a bead beyond can be taken for one "
            "within."
        )
        notices.append(Notice("scan_ambiguous", "warning", said, bead=table.bead))
    kept = slice(first, last)
    return replace(
        table,
        z_nm=table.z_nm[kept],
        profiles=table.profiles[kept],
        noise=table.noise[kept],
        notices=tuple(notices),
    )
