"""One file of a stack, looked at page by page without its pixels.

Every page is checked, so that a fault at the end of a film is told before hours of tracking.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mtpipe.errors import RecordingError
from mtpipe.notice import Notice
from mtpipe.tracking.stack_times import Stamps, StampsOfPages, stamps_of_file
from mtpipe.tracking.tiff import (
    Kind,
    check_data,
    cut_off,
    kind_in_words,
    kind_of_page,
    opened,
    page_of,
)

if TYPE_CHECKING:
    from tifffile import TiffFile

Progress = Callable[[int, int], None]
# What may stand for time: axes named by ImageJ, OME and tifffile.
AXES_OF_FRAMES = "TIQZ"


@dataclass(frozen=True)
class StackFile:
    """One file: how many frames, and where they begin if they follow one another unpacked."""

    path: Path
    frames: int
    offset: int | None
    size: int
    changed_ns: int


@dataclass(frozen=True)
class Look:
    """What was seen in a file: its frames, their kind, the bits that count, and stamps."""

    file: StackFile
    kind: Kind
    bits: int
    stamps: Stamps | None
    notices: tuple[Notice, ...]


def look_at(path: Path, progress: Progress | None, *, ome: bool) -> Look:
    """Look at all pages of a file.

    Parameters
    ----------
    progress : called with (pages looked at, pages).
    ome : take the file as OME or ImageJ have it; else page by page.

    Raises
    ------
    RecordingError : naming file and page: cut off, empty, in colour, or pages that differ.
    """
    status = path.stat()
    with opened(path, ome=ome) as (tif, complaints):
        pages = len(tif.pages)
        if complaints:
            raise cut_off(path, pages, complaints[0])
        notices = _axes(tif, path) if ome else ()
        first = tif.pages.first
        kind = kind_of_page(first, f"{path}, page 1")
        together = _unpaged(tif, pages, path)
        stamps = StampsOfPages(pages)
        frames, offset = pages, None
        if together is not None:
            frames, offset = together
            check_data(first, f"{path}, page 1", status.st_size)
            needed = offset + frames * kind[0] * kind[1] * np.dtype(kind[2]).itemsize
            if needed > status.st_size:
                raise cut_off(path, frames, f"{needed - status.st_size} bytes are missing")
        else:
            for k in range(pages):
                where = f"{path}, page {k + 1}"
                page = page_of(tif, k, where)
                if kind_of_page(page, where) != kind:
                    raise RecordingError(
                        f"has {kind_in_words(kind_of_page(page, where))}, page 1 has "
                        f"{kind_in_words(kind)}; all frames of a stack have one size and type",
                        where=where,
                    )
                check_data(page, where, status.st_size)
                stamps.add(k, page)
                if progress is not None and k % 256 == 0:
                    progress(k, pages)
        found = stamps_of_file(tif, frames) or stamps.found()
        bits = _significant_bits(tif, kind)
    file = StackFile(path, frames, offset, status.st_size, status.st_mtime_ns)
    return Look(file, kind, bits, found, notices)


def _significant_bits(tif: TiffFile, kind: Kind) -> int:
    """Bits per pixel; OME states them where a camera of 12 bit is saved in 16."""
    if not tif.is_ome or not kind[3]:
        return kind[3]
    stated = _stated_bits(tif.ome_metadata or "")
    return stated if stated and stated < kind[3] else kind[3]


def _stated_bits(xml: str) -> int | None:
    """The attribute `SignificantBits` of OME metadata, None without."""
    _, mark, rest = xml.partition('SignificantBits="')
    digits = rest.partition('"')[0]
    return int(digits) if mark and digits.isdecimal() else None


def _unpaged(tif: TiffFile, pages: int, path: Path) -> tuple[int, int] | None:
    """Frames and offset where one header stands for many frames (ImageJ beyond 4 GB, tifffile).

    Raises
    ------
    RecordingError : the header announces more frames than there are pages.
    """
    announced = 1
    if tif.is_imagej:
        announced = int((tif.imagej_metadata or {}).get("images", 1))
    elif tif.is_shaped and tif.shaped_metadata:
        announced = int(np.prod(tif.shaped_metadata[0].get("shape", (1, 1))[:-2]))
    first = tif.pages.first
    if pages == 1 and announced > 1 and first.compression == 1 and len(first.dataoffsets) == 1:
        return announced, first.dataoffsets[0]
    if announced > pages:
        raise cut_off(path, pages, f"its header announces {announced} frames")
    return None


def _axes(tif: TiffFile, path: Path) -> tuple[Notice, ...]:
    """Refuse channels and films in several planes; remark on planes that are taken as frames."""
    if not (tif.is_ome or tif.is_imagej):
        return ()
    series = tif.series[0]
    sizes = {a: n for a, n in zip(series.axes, series.shape, strict=True) if n > 1}
    names = {"C": "channels", "S": "colours", "Z": "focal planes"}
    many = [a for a in sizes if a not in "YX"]
    for axis in many:
        if axis not in AXES_OF_FRAMES or (axis == "Z" and len(many) > 1):
            raise RecordingError(
                f"has {sizes[axis]} {names.get(axis, f'images along {axis}')}, and one grey image "
                "per time is needed",
                where=str(path),
                mend="Save the one in which the beads are to be tracked by itself.",
            )
    if len(tif.series) > 1:
        raise RecordingError(
            f"holds {len(tif.series)} films",
            where=str(path),
            mend="Save the one in which the beads are to be tracked by itself.",
        )
    if many == ["Z"]:
        said = f"{path.name} calls its images focal planes (Z); they are taken as frames in order."
        return (Notice("planes_as_frames", "info", said),)
    return ()


def all_files_of_ome(path: Path) -> list[Path]:
    """The files over which an OME film is spread, in order; the file itself for any other."""
    with opened(path, ome=True) as (tif, _):
        if not tif.is_ome:
            return [path]
        own = tif.series[0].pages
        paths: dict[Path, None] = {}
        for k, page in enumerate(own):
            if page is None:
                raise RecordingError(
                    f"its metadata name a frame {k + 1} that is in none of its files",
                    where=str(path),
                    mend="Copy all files of the film into one folder.",
                )
            paths[Path(page.parent.filehandle.path)] = None
    return list(paths) or [path]
