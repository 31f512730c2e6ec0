"""Whole lines of a text file, block by block, as UTF-8 in memory of pyarrow's own.

pyarrow reads ahead in threads of its own. Handed a Python stream, or memory of Python's, such a
thread may still hold it when the interpreter ends (after a refused file, say): the process then
aborts or never ends (https://github.com/apache/arrow/issues/34314). So the stream is read here.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from itertools import islice
from typing import BinaryIO

import pyarrow as pa

BLOCK_BYTES = 1 << 20
LINE_END = re.compile(rb"\r\n|\r|\n")


def line_blocks(stream: BinaryIO, encoding: str, *, skip: int, tabbed: bool) -> Iterator[pa.Buffer]:
    """Yield the lines after the first `skip`, some `BLOCK_BYTES` at a time, no block all blank.

    Parameters
    ----------
    tabbed : whether every run of blanks within a line becomes one tab.

    Raises
    ------
    OSError, EOFError, zlib.error : as the stream does where it is damaged.
    """
    if tabbed or not _is_ascii_like(encoding):
        blocks = _recoded(stream, encoding, tabbed)
    else:
        blocks = _as_they_are(stream)
    for block in blocks:
        if skip:
            ends = [end.end() for end in islice(LINE_END.finditer(block), skip)]
            skip -= len(ends)
            block = block[ends[-1] :] if ends and not skip else b""
        if block.strip(b"\r\n"):
            yield _arrow_owned(block)


def _is_ascii_like(encoding: str) -> bool:
    """Whether numbers and separators are the same bytes in this encoding as in UTF-8."""
    return "0.,;\t\n".encode(encoding) in (b"0.,;\t\n", b"\xef\xbb\xbf0.,;\t\n")


def _as_they_are(stream: BinaryIO) -> Iterator[bytes]:
    begun = b""
    while read := stream.read(BLOCK_BYTES):
        cut = read.rfind(b"\n") + 1 or read.rfind(b"\r", 0, -1) + 1
        if not cut and len(begun) < BLOCK_BYTES:
            begun += read
            continue
        # where nothing ends a line this is no table: better refused than held whole in memory
        cut = cut or len(read)
        yield begun + read[:cut]
        begun = read[cut:]
    if begun:
        yield begun


def _recoded(stream: BinaryIO, encoding: str, tabbed: bool) -> Iterator[bytes]:
    with io.TextIOWrapper(stream, encoding=encoding, errors="replace") as lines:
        while read := lines.readlines(BLOCK_BYTES):
            if tabbed:
                read = ["\t".join(line.split()) + "\n" for line in read]
            yield "".join(read).encode()


def _arrow_owned(block: bytes) -> pa.Buffer:
    written = pa.BufferOutputStream()
    written.write(block)
    return written.getvalue()
