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

from mtpipe.recording import FloatArray

MARK = b"\n-ibfz "
CURVE = re.compile(rb"\n-ibfz (\d+) (\d+)")
END_OF_TEXT = b"\x1a"


def read_gr(stream: BinaryIO) -> dict[str, FloatArray]:
    """Columns `y`, `curve` and `frame` of all curves, one after another.

    Raises
    ------
    ValueError : the block of values is shorter than the curves, or there is none.
    """
    head, mark, block = stream.read().partition(END_OF_TEXT)
    curves = [(int(offset), int(count)) for offset, count in CURVE.findall(head)]
    if not mark or not curves:
        raise ValueError("it has no binary block of values")
    if max(offset + 4 * count for offset, count in curves) > len(block):
        raise ValueError("its block of values is cut off")
    values = [np.frombuffer(block, "<f4", count, offset) for offset, count in curves]
    lengths = [len(v) for v in values]
    number = np.repeat(np.arange(len(values)), lengths)
    return {
        "y": np.concatenate(values).astype(np.float64),
        "curve": np.asarray(number + 1, dtype=np.float64),
        "frame": np.asarray(np.arange(sum(lengths)) + number, dtype=np.float64),
    }
