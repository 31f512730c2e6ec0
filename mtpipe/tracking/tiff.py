"""TIFF files through tifffile: opened quietly, their pages, and what a page of a film must be.

tifffile reports damage in the log and goes on with what is left; here that is an error, as a film
that ends early without a word would be taken for a short one.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mtpipe.errors import RecordingError

if TYPE_CHECKING:
    from tifffile import TiffFile, TiffPage

TIFF_MAGICS = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
GREY = (0, 1, 32803)  # white is zero, black is zero, raw sensor
COPY_AGAIN = "Copy the file again, or wait until the film has been written."
# Height, width, type as numpy writes it, and bits (0: fractions) of a page.
Kind = tuple[int, int, str, int]


class _Complaints(logging.Handler):
    """Collects what tifffile logs as an error, in its words."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        message = record.getMessage()
        self.said.append(message.rpartition("> ")[2] or message)


@contextmanager
def opened(path: Path, *, ome: bool) -> Iterator[tuple[TiffFile, list[str]]]:
    """A file opened by tifffile, and the list of what it complains about meanwhile."""
    import tifffile

    logger = logging.getLogger("tifffile")
    complaints, talks = _Complaints(), logger.propagate
    logger.addHandler(complaints)
    logger.propagate = False
    try:
        with _tiff_file(tifffile, path, ome) as tif:
            yield tif, complaints.said
    finally:
        logger.removeHandler(complaints)
        logger.propagate = talks


def _tiff_file(tifffile: Any, path: Path, ome: bool) -> TiffFile:
    try:
        with path.open("rb") as stream:
            magic = stream.read(4)
        if magic in TIFF_MAGICS:
            tif: TiffFile = tifffile.TiffFile(path, is_ome=None if ome else False)
            if not _has_pages(tif):
                tif.close()
                raise ValueError("no page is there")
            return tif
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror})", where=str(path)) from None
    except Exception as error:  # a damaged file raises anything
        raise cut_off(path, 0, str(error).splitlines()[0][:200]) from None
    if not magic:
        raise RecordingError("is empty", where=str(path))
    raise RecordingError(
        "is no TIFF file", where=str(path), mend="Save the film as TIFF, e.g. with ImageJ."
    )


def _has_pages(tif: TiffFile) -> bool:
    """Whether there is a first page; the others are not looked for."""
    try:
        return tif.pages.first is not None
    except IndexError:
        return False


def page_of(tif: TiffFile, k: int, where: str) -> TiffPage:
    """Page k (from 0), not kept by tifffile.

    Raises
    ------
    RecordingError : its header is damaged.
    """
    try:
        page: TiffPage = tif.pages.get(k, validate=False, aspage=True)  # type: ignore[assignment]
        return page
    except Exception as error:  # a damaged page raises anything
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise RecordingError(f"is damaged ({reason})", where=where) from None


def kind_of_page(page: TiffPage, where: str) -> Kind:
    """Height, width, type and bits of a page.

    Raises
    ------
    RecordingError : the page is empty, in colour, or of a type that is no grey image.
    """
    if page.samplesperpixel > 1 or page.photometric not in GREY:
        what = "palette" if page.photometric == 3 else f"{page.samplesperpixel} values per pixel"
        raise RecordingError(
            f"is a colour image ({what}), and beads are tracked in grey ones",
            where=where,
            mend="Save the camera's raw images, or convert the stack to 8 or 16 bit grey.",
        )
    if page.imagelength * page.imagewidth == 0:
        raise RecordingError("is empty", where=where)
    if page.imagedepth > 1 or page.dtype is None or page.dtype.kind not in "uif":
        raise RecordingError(
            f"holds {page.dtype} in {page.imagedepth} layers, no grey image", where=where
        )
    if page.bitspersample < 8:
        raise RecordingError(f"has {page.bitspersample} bit per pixel, no grey image", where=where)
    bits = page.bitspersample if page.dtype.kind == "u" else 0
    return page.imagelength, page.imagewidth, page.dtype.str, bits


def check_data(page: TiffPage, where: str, size: int) -> None:
    """Raise RecordingError if a page has no pixels or they lie beyond the file's `size`."""
    if sum(page.databytecounts) == 0:
        raise RecordingError("is empty: it has a header but no pixels", where=where)
    ends = [a + n for a, n in zip(page.dataoffsets, page.databytecounts, strict=True)]
    if max(ends) > size:
        raise RecordingError(
            f"is cut off: {max(ends) - size} bytes are missing",
            where=where,
            mend=COPY_AGAIN,
        )


def kind_in_words(kind: Kind) -> str:
    """Size and type of a page, as a user would say it."""
    height, width, dtype, bits = kind
    return f"{width} x {height} pixels of {f'{bits} bit' if bits else np.dtype(dtype).name}"


def cut_off(path: Path, pages: int, reason: str) -> RecordingError:
    """The error for a file that ends too early."""
    return RecordingError(
        f"is cut off or damaged after page {pages} ({reason})",
        where=str(path),
        mend=COPY_AGAIN,
    )
