"""What kind of file it is, told by how it begins and never by its suffix.

Text named `.xls` is common in this field.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.cells import is_value
from mtpipe.ingest.data_files import DAMAGE, open_stream, read_begin
from mtpipe.ingest.encodings import marked_encoding
from mtpipe.ingest.gr import MARK as GR_MARK
from mtpipe.setup.source_parts import Format

MATLAB_4_BYTES = 20
# Programs pad words in text with zeros, but binary files are full of them.
STRAY_SHARE = 0.02
# Notes of a day are shorter; of a longer file its reader says what is wrong.
LONGEST_PROSE = 1 << 16
HEAD_BYTES = 4096
FOREIGN = {
    b"\xd0\xcf\x11\xe0": ("is an Excel workbook", "Save it as text (CSV)."),
    b"II*\x00": ("is an image stack", "Track the beads first (mtpipe track)."),
    b"MM\x00*": ("is an image stack", "Track the beads first (mtpipe track)."),
    b"II+\x00": ("is an image stack", "Track the beads first (mtpipe track)."),
    b"MM\x00+": ("is an image stack", "Track the beads first (mtpipe track)."),
    b"\x89PNG": (
        "is an image, no trace",
        "Track the beads of an image stack first (mtpipe track).",
    ),
    b"\xff\xd8\xff": (
        "is an image, no trace",
        "Track the beads of an image stack first (mtpipe track).",
    ),
    b"BZh": ("is compressed with bzip2", "Unpack it or use gzip."),
    b"\xfd7zXZ": ("is compressed with xz", "Unpack it or use gzip."),
}


def read_head(path: Path) -> bytes:
    """The first bytes of a file's content.

    Raises
    ------
    RecordingError : the file is empty or its gzip envelope is damaged.
    """
    try:
        with open_stream(path) as stream:
            head = read_begin(stream, HEAD_BYTES)
    except DAMAGE as error:
        raise RecordingError(f"is damaged or cut off ({error})", where=str(path)) from None
    if not head:
        raise RecordingError("is empty", where=str(path))
    return head


def kind_of(path: Path) -> Format:
    """Format of a file by how it begins; "text" where nothing speaks against it.

    Raises
    ------
    RecordingError : empty, damaged, or of a kind that is no recording.
    """
    head = read_head(path)
    for magic, (message, mend) in FOREIGN.items():
        if head.startswith(magic):
            raise RecordingError(message, where=str(path), mend=mend)
    if head.startswith(b"PK\x03\x04"):
        if b"[Content_Types]" in head or b".npy" not in head:
            raise RecordingError(
                "is a zip archive or Excel workbook", where=str(path), mend="Save it as text."
            )
        return "npz"
    magics: dict[bytes, Format] = {
        b"PAR1": "parquet", b"\x89HDF": "hdf5", b"TDSm": "tdms", b"MATLAB 5.0": "matlab",
        b"\x93NUMPY": "npy", **dict.fromkeys((b"CDF\x01", b"CDF\x02", b"CDF\x05"), "netcdf"),
    }  # fmt: skip
    for magic, kind in magics.items():
        if head.startswith(magic):
            return kind
    if head.startswith(b"MATLAB 7.3"):
        return "hdf5"
    if head.startswith(b"%") and GR_MARK in head:
        return "gr"
    if _is_matlab_4(head):
        return "matlab"
    if marked_encoding(head) is None and _is_binary(head.rstrip(b"\x00")):
        raise RecordingError("is a binary file of a kind that is not known", where=str(path))
    return "text"


def is_prose(path: Path) -> bool:
    """Whether a text file is plainly no table: short, and without a line of mostly numbers.

    A file that ends after its header is no prose if the names are those of a canonical recording.
    """
    try:
        with open_stream(path) as stream:
            text = read_begin(stream, LONGEST_PROSE + 1)
    except DAMAGE:  # whoever reads it says what is wrong
        return False
    if len(text) > LONGEST_PROSE or b"\0" in text or b"_nm" in text:
        return False
    return not any(_is_row(line) for line in text.decode("utf-8", "replace").splitlines())


def _is_row(line: str) -> bool:
    cells = [cell for cell in re.split(r"[\s,;|]+", line.replace('"', " ")) if cell]
    return 2 * sum(is_value(cell, ".") for cell in cells) > len(cells)


def _is_binary(head: bytes) -> bool:
    """Whether more bytes than stray ones are none of any text."""
    controls = len(head) - len(head.translate(None, bytes(set(range(32)) - set(b"\t\n\r\f\x1a"))))
    return controls > STRAY_SHARE * len(head)


def _is_matlab_4(head: bytes) -> bool:
    """Whether a file begins with the header of a MATLAB 4 matrix.

    Level 4 MAT-files (MathWorks, MAT-File Format, 2022, section 2): type, rows, columns,
    imaginary part and length of the name, as five integers of 32 bits, then the name.
    """
    if len(head) < MATLAB_4_BYTES:
        return False
    for order in ("<i4", ">i4"):
        kind, rows, columns, imaginary, length = np.frombuffer(head, order, 5).tolist()
        machine, zero, precision, matrix = (kind // 1000, *map(int, f"{kind % 1000:03}"))
        known = kind >= 0 and machine == (order == ">i4") and zero == 0
        known = known and precision <= 5 and matrix <= 2 and imaginary in (0, 1)
        name = head[MATLAB_4_BYTES : MATLAB_4_BYTES + max(0, length)]
        if known and min(rows, columns) >= 0 and name.endswith(b"\0"):
            return name[:-1].replace(b"_", b"").isalnum()
    return False
