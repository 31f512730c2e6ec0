"""One file of a stack, looked at page by page without its pixels.

Every page is checked, so that a fault at the end of a film is told before hours of tracking.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ground.types import Progress
from mtpipe.tracking.stack_times import Stamps, StampsOfPages, stamps_of_file
from mtpipe.tracking.tiff import (
    Kind,
    check_data,
    cut_off,
    damaged,
    image_at,
    kind_of_page,
    opened,
    page_of,
)

if TYPE_CHECKING:
    from tifffile import TiffFile

    from mtpipe.setup.tracking_table import Tracking

# What may stand for time: axes named by ImageJ, OME and tifffile.
AXES_OF_FRAMES = "TIQZ"
AXIS_NAMES = {"C": "channels", "S": "colours", "Z": "focal planes"}
# Zeros at the end of a frame are those of a file that was not written to its end if they are this
# many more than in other frames; a darkened corner, or values below a threshold, are in all.
FEWEST_ZEROS = 16
COMPARED_FRAMES = 16
SAVE_ONE = "Save the one in which the beads are to be tracked by itself."


@dataclass(frozen=True)
class Reading:
    """How the setup wants a film to be read: channels as frames, what is there if it is cut off."""

    channels_are_frames: bool = False
    take_incomplete: bool = False

    @classmethod
    def chosen(cls, tracking: Tracking) -> Reading:
        """As `[tracking]` has it."""
        return cls(tracking.frames == "channels", tracking.incomplete == "take")


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
    """What was seen in a file: its frames, their kind, the bits that count, and stamps.

    `announced` is how many frames its header speaks of, which may be those of a whole series.
    """

    file: StackFile
    kind: Kind
    bits: int
    announced: int
    stamps: Stamps | None
    notices: tuple[Notice, ...]


def look_at(path: Path, progress: Progress | None, *, ome: bool, reading: Reading) -> Look:
    """Look at all pages of a file.

    Parameters
    ----------
    progress : called with (pages looked at, pages).
    ome : take the file as OME or ImageJ have it; else page by page.

    Raises
    ------
    RecordingError : naming file and page: cut off, empty, in colour, or pages that differ.
    """
    with opened(path, ome=ome) as (tif, complaints):
        try:
            return _seen(tif, complaints, path, progress, ome, reading)
        except (RecordingError, OSError):
            raise
        except Exception as error:  # a damaged file raises anything
            raise damaged(path, error) from None


def _seen(
    tif: TiffFile,
    complaints: list[str],
    path: Path,
    progress: Progress | None,
    ome: bool,
    reading: Reading,
) -> Look:
    status = path.stat()
    pages = len(tif.pages)
    fault = cut_off(path, pages, complaints[0]) if complaints else None
    if fault is not None and not reading.take_incomplete:
        raise fault
    notices = _axes(tif, path, reading) if ome else ()
    first = tif.pages.first
    kind = kind_of_page(first, f"{path}, page 1")
    check_data(first, f"{path}, page 1", status.st_size)
    announced = _announced(tif, kind)
    stamps = StampsOfPages(pages)
    offset = _unpaged(tif, pages, announced)
    if offset is not None:
        frames = min(announced, (status.st_size - offset) // kind.nbytes)
    else:
        frames = pages
        for k in range(pages):
            try:
                its_kind = _kind_of(tif, k, path, status.st_size, stamps)
            except RecordingError as error:
                frames, fault = k, error
                break
            if its_kind != kind:
                raise RecordingError(
                    f"has {its_kind.in_words()}, page 1 has {kind.in_words()}; all frames of a "
                    "stack have one size and type",
                    where=f"{path}, page {k + 1}",
                )
            if progress is not None and k % 256 == 0:
                progress(k, pages)
    if fault is not None and not reading.take_incomplete:
        raise fault
    whole = _written(tif, frames, offset, kind, path, reading)
    if whole < frames:
        fault = cut_off(path, whole, _zeros_in_words(frames - whole))
    if fault is not None:
        if not reading.take_incomplete or whole == 0:
            raise fault
        said = f"{path.name} is cut off or damaged: the {whole} frames before that are taken."
        notices += (Notice("film_incomplete", "caution", said),)
    white = "White is zero in it, and grey levels are turned round."
    notices += (Notice("white_is_zero", "info", f"{path.name}: {white}"),) * kind.white_is_zero
    file = StackFile(path, whole, offset, status.st_size, status.st_mtime_ns)
    announced = whole if fault is not None else max(announced, whole)
    found = stamps_of_file(tif, whole) or stamps.found(whole)
    return Look(file, kind, _significant_bits(tif, kind), announced, found, notices)


def _kind_of(tif: TiffFile, k: int, path: Path, size: int, stamps: StampsOfPages) -> Kind:
    """What page k (from 0) is, whose pixels are all there; its stamps are taken.

    Raises
    ------
    RecordingError : it is damaged, or no grey image.
    """
    where = f"{path}, page {k + 1}"
    page = page_of(tif, k, where)
    kind = kind_of_page(page, where)
    check_data(page, where, size)
    stamps.add(k, page)
    return kind


def _written(
    tif: TiffFile, frames: int, offset: int | None, kind: Kind, path: Path, reading: Reading
) -> int:
    """Frames before those that are zero to the end of the film, as of a copy that broke off.

    The first of these may be zero in part. A film that is zero throughout has none that are worth
    less than others.

    Raises
    ------
    RecordingError : one cannot be decoded, and what is there before it is not asked for.
    """
    pixels = kind.height * kind.width

    def zeros_at_end(k: int) -> int:
        try:
            image = image_at(tif, k, offset, kind, f"{path}, page {k + 1}")
        except RecordingError:
            if not reading.take_incomplete:
                raise
            return pixels
        written = np.flatnonzero(image)
        return pixels - (int(written[-1]) + 1 if written.size else 0)

    last = frames
    while last > 0 and (zeros := zeros_at_end(last - 1)) == pixels:
        last -= 1
    if last == 0:
        return frames
    others = np.unique(np.linspace(0, last - 2, COMPARED_FRAMES).astype(int)) if last > 1 else ()
    usual = max((zeros_at_end(int(k)) for k in others), default=pixels)
    return last - (zeros > 2 * usual + FEWEST_ZEROS)


def _zeros_in_words(frames: int) -> str:
    return (
        "the frame after it is all zero, or ends in zeros as no other does"
        if frames == 1
        else f"the {frames} frames after it are all zero"
    )


def _significant_bits(tif: TiffFile, kind: Kind) -> int:
    """Bits per pixel; OME states them where a camera of 12 bit is saved in 16."""
    if not tif.is_ome or not kind.bits:
        return kind.bits
    stated = _stated_bits(tif.ome_metadata or "")
    return stated if stated and stated < kind.bits else kind.bits


def _stated_bits(xml: str) -> int | None:
    """The attribute `SignificantBits` of OME metadata, None without."""
    _, mark, rest = xml.partition('SignificantBits="')
    digits = rest.partition('"')[0]
    return int(digits) if mark and digits.isdecimal() else None


def _announced(tif: TiffFile, kind: Kind) -> int:
    """Frames that the header speaks of (ImageJ, tifffile); 1 where it does not count them."""
    if tif.is_imagej:
        return int((tif.imagej_metadata or {}).get("images", 1))
    if tif.is_shaped and tif.shaped_metadata:
        # counted in pixels: axes of one may stand anywhere
        pixels = sum(int(np.prod(told.get("shape", ()))) for told in tif.shaped_metadata)
        return pixels // (kind.height * kind.width)
    return 1


def _unpaged(tif: TiffFile, pages: int, announced: int) -> int | None:
    """Offset of the frames where one header stands for many (ImageJ beyond 4 GB, tifffile)."""
    first = tif.pages.first
    if pages == 1 and announced > 1 and first.compression == 1 and len(first.dataoffsets) == 1:
        return int(first.dataoffsets[0])
    return None


def _axes(tif: TiffFile, path: Path, reading: Reading) -> tuple[Notice, ...]:
    """Refuse channels and films in several planes; remark on what is taken as frames."""
    if not (tif.is_ome or tif.is_imagej):
        return ()
    series = tif.series[0]
    sizes = {a: n for a, n in zip(series.axes, series.shape, strict=True) if n > 1}
    many = [a for a in sizes if a not in "YX"]
    if many == ["C"] and reading.channels_are_frames:
        said = f'{path.name} calls its images channels; [tracking] frames = "channels" takes them.'
        return (Notice("channels_as_frames", "info", said),)
    for axis in many:
        if axis not in AXES_OF_FRAMES or (axis == "Z" and len(many) > 1):
            else_frames = ' If they are frames, write frames = "channels" into [tracking].'
            raise RecordingError(
                f"has {sizes[axis]} {AXIS_NAMES.get(axis, f'images along {axis}')}, and one grey "
                "image per time is needed",
                where=str(path),
                mend=SAVE_ONE + else_frames * (many == ["C"]),
            )
    if len(tif.series) > 1:
        raise RecordingError(f"holds {len(tif.series)} films", where=str(path), mend=SAVE_ONE)
    if many == ["Z"]:
        said = f"{path.name} calls its images focal planes (Z); they are taken as frames in order."
        return (Notice("planes_as_frames", "info", said),)
    return ()
