"""Files of which no more is asked for than they hold, whatever their headers announce.

Libraries ask a file for as many bytes as a header says, and Python makes room for all of them
before it looks what is there: a length of eight changed bytes would take all memory.
"""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path
from typing import BinaryIO

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.announced import (
    HARMLESS_BYTES,
    NUMBER_BYTES,
    check_announced,
    check_fits,
    check_room,
)

PIECE_BYTES = 1 << 24


class BoundedReader(io.BufferedReader):
    """A file opened for reading bytes."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._size = os.fstat(self.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """The next bytes, at most the number asked for; all that are left by default."""
        if size is not None and size > HARMLESS_BYTES:
            size = min(size, max(0, self._size - self.tell()))
        return super().read(size)


def unpacked(stream: BinaryIO, where: str) -> io.BytesIO:
    """All that a packed stream unfolds to, if it fits into the memory twice.

    Raises
    ------
    RecordingError : it does not.
    """
    whole = io.BytesIO()
    while piece := stream.read(PIECE_BYTES):
        whole.write(piece)
        check_fits(whole.tell() // NUMBER_BYTES, where)
    whole.seek(0)
    return whole


def check_archive(archive: zipfile.ZipFile, size: int, file: str = "") -> None:
    """Raise RecordingError if members of an archive of `size` bytes cannot be in it, or be read.

    Parameters
    ----------
    file : what it is called, where nothing else names it.
    """
    for one in archive.infolist():
        where = f"{file}, {one.filename}" if file else one.filename
        if one.compress_size > size:
            said = f"announces {one.compress_size} bytes in an archive of {size}"
            raise RecordingError(f"{said}: it is cut off or damaged", where=where)
        packed = one.compress_type != zipfile.ZIP_STORED
        check_announced(one.file_size, one.compress_size, packed, where)
        check_room(one.file_size, where)
