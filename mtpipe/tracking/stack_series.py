"""Whether all files of a film are there, and all frames that its headers speak of.

Camera programs announce a film before it is taken: it may have been stopped by hand, and one that
is split over files has the number of all its frames in the header of each.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.tracking.stack_look import Look, Reading
from mtpipe.tracking.stack_times import stamps_of_file
from mtpipe.tracking.tiff import TAKE, damaged, opened

if TYPE_CHECKING:
    from tifffile import TiffFile

FILE_NAME = re.compile(r'FileName="([^"]*)"')


def files_of_ome(path: Path, reading: Reading) -> tuple[list[Path], tuple[Notice, ...]]:
    """The files over which an OME film is spread, in order; the file itself for any other.

    Raises
    ------
    RecordingError : its metadata name frames that are in none of its files; not where it was
        stopped by hand, which a notice says.
    """
    with opened(path, ome=True) as (tif, complaints):
        if not tif.is_ome:
            return [path], ()
        try:
            own = list(tif.series[0].pages)
        except Exception as error:  # a damaged file raises anything
            raise damaged(path, error) from None
        pages = list(takewhile(lambda page: page is not None, own))
        there = len(pages)
        files = list(dict.fromkeys(Path(page.parent.filehandle.path) for page in pages if page))
        if there == len(own) or complaints:  # what is complained about is told page by page
            return files or [path], ()
        stopped = not any(own[there:]) and _was_stopped(tif, path.parent, there)
        if not stopped and not reading.take_incomplete:
            raise RecordingError(
                f"its metadata name a frame {there + 1} that is in none of its files",
                where=str(path),
                mend=f"Copy all files of the film into one folder. {TAKE}",
            )
    why = ", as of an acquisition that was stopped by hand" if stopped else ""
    said = f"{path.name} was planned for {len(own)} frames, {there} are there{why}; they are taken."
    return files or [path], (Notice("film_incomplete", "caution", said),)


def _was_stopped(tif: TiffFile, folder: Path, there: int) -> bool:
    """Whether no file is missing that OME metadata name, and no frame that was given a time."""
    named = set(FILE_NAME.findall(tif.ome_metadata or ""))
    if any(not (folder / name).is_file() for name in named):
        return False
    stamps = stamps_of_file(tif, there)
    if stamps is None or stamps.time_s is None:
        return True
    return not np.isfinite(stamps.time_s[there:]).any()


def missing_frames(looks: Sequence[Look], reading: Reading) -> tuple[Notice, ...]:
    """What is to be said of frames that headers announce and that are not there.

    Raises
    ------
    RecordingError : there are such frames, and what is there is not asked for.
    """
    total = sum(look.file.frames for look in looks)
    short = next((one for one in looks if one.announced not in (one.file.frames, total)), None)
    if short is None:
        return ()
    there = short.file.frames if len(looks) == 1 else total
    said = f"its header announces {short.announced} frames, {there} are there"
    if not reading.take_incomplete:
        raise RecordingError(
            f"is cut off, or was stopped by hand: {said}",
            where=str(short.file.path),
            mend="Copy the file again, or give all files of its series (a folder or a pattern). "
            + TAKE,
        )
    said = f"{short.file.path.name} is not whole: {said}, and those are taken."
    return (Notice("film_incomplete", "caution", said),)
