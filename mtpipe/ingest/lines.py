"""Whole lines of a text file, block by block, as UTF-8 in memory of pyarrow's own.

pyarrow reads ahead in threads of its own. Handed a Python stream, or memory of Python's, such a
thread may still hold it when the interpreter ends (after a refused file, say): the process then
aborts or never ends (https://github.com/apache/arrow/issues/34314). So the stream is read here.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from itertools import islice
from typing import BinaryIO

import pyarrow as pa

BLOCK_BYTES = 1 << 20
LINE_END = re.compile(rb"\r\n|\r|\n")


def line_blocks(
    stream: BinaryIO, encoding: str, *, skip: int, tabbed: bool, comment: str = ""
) -> Iterator[pa.Buffer]:
    """Yield the lines after the first `skip`, some `BLOCK_BYTES` at a time, no block all blank.

    Parameters
    ----------
    tabbed : whether every run of blanks within a line becomes one tab.
    comment : what lines begin with that are emptied, as are lines of blanks; "" for no such lines.

    Raises
    ------
    OSError, EOFError, zlib.error : as the stream does where it is damaged, after all whole lines
        before.
    """
    remarks = _remarks(comment, tabbed)
    signs = [b"\n ", b"\r ", b"\n\t", b"\r\t", *([comment.encode()] if comment else [])]
    for block in _whole_lines(_pieces(stream, encoding)):
        if skip:
            ends = [end.end() for end in islice(LINE_END.finditer(block), skip)]
            skip -= len(ends)
            block = block[ends[-1] :] if ends and not skip else b""
        led = b"\n" + block
        if any(sign in led for sign in signs):  # told much faster than by the pattern
            block = remarks.sub(rb"\1", led)[1:]
        if block.strip(b"\r\n"):
            yield _arrow_owned(_tabbed(block) if tabbed else block)


def _remarks(comment: str, tabbed: bool) -> re.Pattern[bytes]:
    """Matches a line end and the line after it, if that is blank or a remark."""
    # in a file whose columns are separated by tabs, tabs alone are a row without any number
    blank = rb"[ \t]+" if tabbed else rb" +"
    content = rb"[ \t]*" + re.escape(comment.encode()) + rb"[^\r\n]*|" if comment else rb""
    return re.compile(rb"([\r\n])(?:" + content + blank + rb")(?=[\r\n]|\Z)")


def _is_ascii_like(encoding: str) -> bool:
    """Whether numbers and separators are the same bytes in this encoding as in UTF-8."""
    return "0.,;\t\n".encode(encoding) in (b"0.,;\t\n", b"\xef\xbb\xbf0.,;\t\n")


def _pieces(stream: BinaryIO, encoding: str) -> Iterator[bytes]:
    """The stream in pieces, recoded where numbers are other bytes than in UTF-8."""
    decoder = None
    if not _is_ascii_like(encoding):
        decoder = codecs.getincrementaldecoder(encoding)("replace")
    read = getattr(stream, "read1", stream.read)  # what there is before the damage, and no more
    while piece := read(BLOCK_BYTES):
        yield piece if decoder is None else decoder.decode(piece).encode()
    if decoder is not None:
        yield decoder.decode(b"", final=True).encode()


def _whole_lines(pieces: Iterator[bytes]) -> Iterator[bytes]:
    held: list[bytes] = []
    size = 0
    try:
        for piece in pieces:
            held.append(piece)
            size += len(piece)
            if size < BLOCK_BYTES:
                continue
            joined = b"".join(held)
            # where nothing ends a line this is no table: better refused than held whole in memory
            cut = joined.rfind(b"\n") + 1 or joined.rfind(b"\r", 0, -1) + 1 or len(joined)
            yield joined[:cut]
            held, size = [joined[cut:]], len(joined) - cut
    except Exception:
        joined = b"".join(held)
        whole = joined[: joined.rfind(b"\n") + 1]
        if whole:
            yield whole
        raise
    if size:
        yield b"".join(held)


def _tabbed(block: bytes) -> bytes:
    lines = LINE_END.split(block)
    return b"\n".join(b"\t".join(line.split()) for line in lines)


def _arrow_owned(block: bytes) -> pa.Buffer:
    written = pa.BufferOutputStream()
    written.write(block)
    return written.getvalue()
