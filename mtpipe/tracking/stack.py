"""Image stacks: what is in the files, checked page by page, and its frames in chunks.

A stack is one file of many pages (TIFF, BigTIFF, ImageJ, OME) or a series of files in name order,
numbers by value. Opening goes through all pages once, without their pixels, so that a fault at
the end of a film is told before hours of tracking; the stack then keeps a time stamp per frame
and tifffile an offset per page, and nothing else grows with the length. Frames are grey images of
one size and type. A stack of focal planes (Z) alone is taken as frames; channels are refused.
"""

from __future__ import annotations

import glob
import os
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ground.types import Progress
from mtpipe.ingest.data_files import SETUP_NAME, data_files, natural_order
from mtpipe.setup.setup import read_setup
from mtpipe.tracking.stack_look import Look, Reading, StackFile, look_at
from mtpipe.tracking.stack_series import files_of_ome, missing_frames
from mtpipe.tracking.stack_times import Stamps
from mtpipe.tracking.tiff import TIFF_MAGICS, Kind, image_at, opened

Images = NDArray[Any]
SUFFIXES = (".tif", ".tiff", ".btf", ".tf8")
CHUNK_BYTES = 1 << 25
LONGEST_CHUNK = 128


@dataclass(frozen=True)
class Stack:
    """A stack whose pages have been looked at, but not read.

    Attributes
    ----------
    name : of the file, or of the series' folder.
    files : in the order of reading.
    kind : of every frame: size and type of its pixels as they are read.
    bits : significant bits of a pixel; the largest value is 2**bits - 1. 0 for fractions.
    stamps : times of the frames that the files state; None where they state none.
    """

    name: str
    files: tuple[StackFile, ...]
    kind: Kind
    bits: int
    stamps: Stamps | None
    notices: tuple[Notice, ...]

    @property
    def height(self) -> int:
        """Of every frame, pixels."""
        return self.kind.height

    @property
    def width(self) -> int:
        """Of every frame, pixels."""
        return self.kind.width

    @property
    def frames(self) -> int:
        """Number of frames in all files."""
        return sum(file.frames for file in self.files)

    @property
    def highest(self) -> float | None:
        """The grey level of a saturated pixel, by its bits; None where they do not say."""
        return float(2**self.bits - 1) if self.bits else None

    @property
    def chunk_frames(self) -> int:
        """Frames per chunk: at most 32 MiB, and at most 128."""
        return max(1, min(LONGEST_CHUNK, CHUNK_BYTES // self.kind.nbytes))

    def chunks(self, frames: int | None = None) -> Generator[Images, None, None]:
        """Frames in order, as arrays (at most `frames`, height, width); never more than one chunk.

        Raises
        ------
        RecordingError : a page cannot be decoded, or a file changed since it was opened.
        """
        size = frames or self.chunk_frames
        chunk = np.empty((size, self.height, self.width), np.dtype(self.kind.dtype))
        filled = 0
        for file in self.files:
            for image in _frames(file, self):
                chunk[filled] = image
                filled += 1
                if filled == size:
                    check_unchanged(file)
                    yield chunk
                    chunk, filled = np.empty_like(chunk), 0
            check_unchanged(file)
        if filled:
            yield chunk[:filled]


def open_stack(
    path: Path, progress: Progress | None = None, reading: Reading | None = None
) -> Stack:
    """Look at all pages of a stack.

    Parameters
    ----------
    path : a file, a folder with a series of files, or a pattern such as `film_*.tif`.
    progress : called with (files or pages looked at, of how many).
    reading : what the setup says of channels and of films that are not whole.

    Raises
    ------
    RecordingError : naming file and page: no TIFF, cut off, an empty page, colour, several
        channels, pages that differ, fewer than two frames.
    """
    reading = reading or Reading()
    paths = find_files(path)
    notices: list[Notice] = []
    spread = False
    if len(paths) == 1:
        paths, said_of_ome = files_of_ome(paths[0], reading)
        spread = len(paths) > 1
        notices += said_of_ome
    say = progress or (lambda done, total: None)
    looks: list[Look] = []
    for done, one in enumerate(paths):
        alone = len(paths) == 1
        ome = alone or paths[0] == one
        looks.append(look_at(one, say if alone else None, ome=ome, reading=reading))
        first, this = looks[0], looks[-1]
        if this.kind != first.kind:
            raise RecordingError(
                f"has {this.kind.in_words()}, {first.file.path.name} has "
                f"{first.kind.in_words()}; all frames of a stack have one size and type",
                where=str(one),
            )
        if not alone:
            say(done + 1, len(paths))
    files = tuple(look.file for look in looks)
    notices += [notice for look in looks for notice in look.notices]
    notices += missing_frames(looks, reading)
    # the first file of a film that OME spreads over several speaks for all
    telling = looks[:1] if spread else looks
    stamps, said = Stamps.joined([look.stamps for look in telling], [f.frames for f in files])
    if len(files) > 1:
        notices += _gaps(files)
    name = files[0].path.name if len(files) == 1 else files[0].path.parent.resolve().name
    stack = Stack(
        name,
        files,
        looks[0].kind,
        looks[0].bits,
        stamps,
        (*dict.fromkeys(notices), *said),
    )
    if stack.frames < 2:
        raise RecordingError(
            "has one frame, and motion takes at least two",
            where=str(path),
            mend="Give the whole film: a file of many pages, or the folder of its files.",
        )
    return stack


def is_stack(path: Path, setup: Path | None = None) -> bool:
    """Whether a path is for `mtpipe track`: a TIFF file, a folder of images, a pattern.

    A folder with other data beside the images is the recording that these are, unless they are
    look-up tables or the log of the magnets that `[tracking]` names.

    Parameters
    ----------
    setup : setup.toml; default: the one in the folder.

    Raises
    ------
    SetupError : there are other data, and the setup cannot be read.
    """
    if path.is_file():
        with path.open("rb") as stream:
            return stream.read(4) in TIFF_MAGICS
    if path.is_dir():
        if not any(p.suffix.lower() in SUFFIXES for p in path.iterdir()):
            return False
        data = {p.resolve() for p in data_files(path) if p.suffix != ".npz"}
        return not data or data <= _magnet_logs(path, setup or path / SETUP_NAME)
    return is_pattern(path)


def _magnet_logs(folder: Path, setup: Path) -> set[Path]:
    """The files in which the setup's `[tracking.magnet]` has the magnets of a folder of images."""
    magnet = read_setup(setup).tracking.magnet
    logs = [] if magnet is None else magnet.logs(find_files(folder), setup.parent)
    return {log.resolve() for log in logs}


def find_files(path: Path) -> list[Path]:
    """Files of a stack in the order of their names, numbers by value.

    Raises
    ------
    RecordingError : there is none.
    """
    if path.is_file():
        return [path]
    if path.is_dir():
        found = [
            p
            for p in path.iterdir()
            # hidden ones are not images: macOS writes `._film.tif` beside film.tif
            if p.suffix.lower() in SUFFIXES and p.is_file() and not p.name.startswith(".")
        ]
        nothing = "the folder has no TIFF files"
    else:
        found = [p for p in named_like(path) if p.is_file()]
        nothing = "there is no such file or folder"
        if is_pattern(path):
            nothing = "no file has a name of this pattern"
    if not found:
        raise RecordingError(nothing, where=str(path))
    return sorted(found, key=natural_order)


def is_pattern(path: Path) -> bool:
    """Whether a path is a pattern of the names of a series of files."""
    return any(mark in path.name for mark in "*?[")


def named_like(pattern: Path) -> list[Path]:
    """What has a name of a pattern; a folder that is there goes by its name, `exp[2026]` too."""
    folder = pattern.parent
    known = glob.escape(str(folder)) if folder.is_dir() else str(folder)
    return [Path(found) for found in glob.glob(os.path.join(known, pattern.name))]


def _gaps(files: tuple[StackFile, ...]) -> list[Notice]:
    """Remark on numbers that are missing among the names of a series."""
    numbers = [[part[1] for part in natural_order(f.path) if part[0] == 0] for f in files]
    if len({len(n) for n in numbers}) != 1 or not numbers[0]:
        return []
    table = np.array(numbers)
    running = [k for k in range(table.shape[1]) if len(np.unique(table[:, k])) == len(files)]
    if not running:
        return []
    steps = np.diff(table[:, running[-1]])
    usual = int(np.min(steps))
    missing = int(np.sum(steps // usual - 1)) if usual > 0 else 0
    if not missing:
        return []
    at = int(np.argmax(steps > usual))
    said = (
        f"{missing} numbers are missing among the names of the {len(files)} files, the first "
        f"after {files[at].path.name}; the files are taken to follow one another."
    )
    return [Notice("missing_files", "warning", said)]


def _frames(file: StackFile, stack: Stack) -> Iterator[Images]:
    """The frames of a file one by one, white as their largest grey level."""
    with opened(file.path, ome=False) as (tif, _):
        for k in range(file.frames):
            try:
                image = image_at(tif, k, file.offset, stack.kind, f"{file.path}, page {k + 1}")
            except RecordingError:
                check_unchanged(file)
                raise
            if stack.kind.white_is_zero:
                white = 2**stack.bits - 1
                image = white - np.minimum(image, white)
            yield image


def check_unchanged(file: StackFile) -> None:
    """Raise RecordingError if a file is not as it was when it was looked at."""
    try:
        status = file.path.stat()
    except OSError as error:
        raise RecordingError(
            f"cannot be read any more ({error.strerror})", where=str(file.path)
        ) from None
    if (status.st_size, status.st_mtime_ns) == (file.size, file.changed_ns):
        return
    more = status.st_size - file.size
    how = f"grew by {more} bytes" if more > 0 else "changed"
    raise RecordingError(
        f"{how} while it was read: the film is still being written",
        where=str(file.path),
        mend="Wait until the recording has ended, then track it.",
    )
