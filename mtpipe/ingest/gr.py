"""PicoTwist's plot files (`.gr`): a text head that lists curves, then their binary values.

Each curve has a line `-ibfz OFFSET COUNT`: bytes into the block of little-endian float32 that
follows the control character SUB (0x1A) at the end of the text. Read off from a file; only this
form is known. The curves of one bead's cycles follow one another as one trace: column `y`, its
`curve` (from 1) and `frame`, which skips one number between curves, as the file does not say how
long the pause between them was.
"""

from __future__ import annotations

import re
from typing import BinaryIO

import numpy as np

from mtpipe.ingest.contents import Contents

MARK = b"\n-ibfz "
CURVE = re.compile(rb"\n-ibfz (\d+) (\d+)")
END_OF_TEXT = b"\x1a"


def open_gr(stream: BinaryIO) -> Contents:
    """List columns `y`, `curve` and `frame` of all curves, one after another.

    Raises
    ------
    ValueError : there is no block of values.
    """
    head, mark, block = stream.read().partition(END_OF_TEXT)
    curves = [(int(offset), int(count)) for offset, count in CURVE.findall(head)]
    if not mark or not curves:
        raise ValueError("it has no binary block of values")
    there = [max(0, min(count, (len(block) - offset) // 4)) for offset, count in curves]
    values = [
        np.frombuffer(block, "<f4", count, offset if count else 0)
        for (offset, _), count in zip(curves, there, strict=True)
    ]
    number = np.repeat(np.arange(len(values)), there)
    contents = Contents()
    if sum(there) < sum(count for _, count in curves):
        contents.cut = f"is cut off: {sum(there)} of {sum(c for _, c in curves)} values are there"
    columns = {
        "y": np.concatenate(values).astype(np.float64),
        "curve": np.asarray(number + 1, dtype=np.float64),
        "frame": np.asarray(np.arange(sum(there)) + number, dtype=np.float64),
    }
    for name, column in columns.items():
        contents.add(name, column.shape, column.dtype, column.__getitem__)
    return contents
