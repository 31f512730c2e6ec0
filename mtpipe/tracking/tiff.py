"""TIFF files through tifffile: opened quietly, their pages, and what a page of a film must be.

tifffile reports damage in the log and goes on with what is left; here that is an error, as a film
that ends early without a word would be taken for a short one.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.announced import check_announced, check_room, no_room

if TYPE_CHECKING:
    from tifffile import TiffFile, TiffPage

TIFF_MAGICS = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
WHITE_IS_ZERO = 0
GREY = (WHITE_IS_ZERO, 1, 32803)  # the others: black is zero, raw sensor
# A frame is held as it was decoded, and once more among those that are tracked.
HELD_IMAGES = 2
TAKE = 'To take what is there, write incomplete = "take" into [tracking].'
COPY_AGAIN = f"Copy the file again, or wait until the film has been written. {TAKE}"


class Kind(NamedTuple):
    """What all pages of a film have in common; `dtype` as numpy writes it, `bits` 0: fractions."""

    height: int
    width: int
    dtype: str
    bits: int
    white_is_zero: bool

    @property
    def nbytes(self) -> int:
        """Bytes of a frame as it is read."""
        return self.height * self.width * np.dtype(self.dtype).itemsize

    def in_words(self) -> str:
        """Size and type of a page, as a user would say it."""
        levels = f"{self.bits} bit" if self.bits else np.dtype(self.dtype).name
        said = f"{self.width} x {self.height} pixels of {levels}"
        return f"{said} (white is zero)" if self.white_is_zero else said


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
        raise cut_off(path, 0, reason_of(error)) from None
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
        raise RecordingError(f"is damaged ({reason_of(error)})", where=where) from None


def kind_of_page(page: TiffPage, where: str) -> Kind:
    """What a page is.

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
        raise RecordingError("is empty", where=where, mend=COPY_AGAIN)
    if page.imagedepth > 1 or page.dtype is None or page.dtype.kind not in "uif":
        raise RecordingError(
            f"holds {page.dtype} in {page.imagedepth} layers, no grey image", where=where
        )
    if page.bitspersample < 8:
        raise RecordingError(f"has {page.bitspersample} bit per pixel, no grey image", where=where)
    bits = page.bitspersample if page.dtype.kind == "u" else 0
    white_is_zero = page.photometric == WHITE_IS_ZERO
    if white_is_zero and not bits:
        raise RecordingError(
            f"says that white is zero of {page.dtype.name}, which have no other end",
            where=where,
            mend="Save the film in 8 or 16 bit.",
        )
    return Kind(page.imagelength, page.imagewidth, page.dtype.str, bits, white_is_zero)


def check_data(page: TiffPage, where: str, size: int) -> None:
    """Raise RecordingError if a page's pixels are not all in the file, which has `size` bytes."""
    offsets, counts = page.dataoffsets, page.databytecounts
    if not counts or sum(counts) == 0:
        said = "is empty: it has a header but no pixels"
        raise RecordingError(said, where=where, mend=COPY_AGAIN)
    if len(offsets) != len(counts) or min(offsets) < 0 or min(counts) < 0:
        said = f"is damaged ({len(offsets)} pieces of pixels, and sizes of {len(counts)})"
        raise RecordingError(said, where=where, mend=COPY_AGAIN)
    ends = [a + n for a, n in zip(offsets, counts, strict=True)]
    if max(ends) > size:
        raise RecordingError(
            f"is cut off: {max(ends) - size} bytes are missing",
            where=where,
            mend=COPY_AGAIN,
        )
    image = page.imagelength * page.imagewidth * page.bitspersample // 8
    check_announced(image, sum(counts), page.compression != 1, where)
    check_room(HELD_IMAGES * image, where)


def image_at(tif: TiffFile, k: int, offset: int | None, kind: Kind, where: str) -> NDArray[Any]:
    """Frame k (from 0), (height, width), as it stands in the file.

    Parameters
    ----------
    offset : of the first frame, where frames follow one another unpacked under one header.

    Raises
    ------
    RecordingError : it cannot be decoded.
    """
    try:
        if offset is None:
            return page_of(tif, k, where).asarray()
        dtype = np.dtype(kind.dtype).newbyteorder(tif.byteorder)
        handle = tif.filehandle
        handle.seek(offset + k * kind.nbytes)
        image: NDArray[Any] = handle.read_array(dtype, kind.height * kind.width)
        return image.reshape(kind.height, kind.width)
    except RecordingError:
        raise
    except MemoryError:
        raise no_room(where) from None
    except Exception as error:  # a damaged page raises anything
        said = f"cannot be decoded ({reason_of(error)})"
        raise RecordingError(said, where=where, mend=COPY_AGAIN) from None


def reason_of(error: Exception) -> str:
    """What a library says of damage, in one line; its kind where it says nothing."""
    lines = str(error).splitlines() or [""]
    return f"{type(error).__name__}: {lines[0][:200]}".removesuffix(": ")


def damaged(path: Path, error: Exception) -> RecordingError:
    """The error for a file of which a library says something odd."""
    said = f"is damaged ({reason_of(error)})"
    return RecordingError(said, where=str(path), mend="Copy the file again.")


def cut_off(path: Path, pages: int, reason: str) -> RecordingError:
    """The error for a file that ends too early."""
    return RecordingError(
        f"is cut off or damaged after page {pages} ({reason})",
        where=str(path),
        mend=COPY_AGAIN,
    )
