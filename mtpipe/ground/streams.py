"""Standard output and errors, whatever reads them.

They may be of any encoding, closed from the start, or a pipe whose reader goes away; and names of
beads and files may hold what a terminal would obey.
"""

from __future__ import annotations

import io
import os
import sys
import unicodedata
from typing import Any, TextIO

import typer


def open_streams() -> None:
    """Make both streams robust; what cannot be said in their encoding becomes a question mark.

    A stream that Python's own has been replaced by is left alone.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # else the next file that is opened would take its place
            os.open(os.devnull, os.O_RDWR)
    if sys.stdout is sys.__stdout__:
        sys.stdout = _robust(sys.stdout, 1)
    if sys.stderr is sys.__stderr__:
        sys.stderr = _robust(sys.stderr, 2)


def say(text: str, *, err: bool = False) -> None:
    """Print lines, in which names are nothing but words."""
    typer.echo(visible(text), err=err)


def visible(text: str) -> str:
    """Lines in which characters that a terminal would obey are written as their codes."""
    return "".join(
        c if c == "\n" or unicodedata.category(c)[0] != "C" else ascii(c).strip("'") for c in text
    )


def _robust(stream: TextIO | None, number: int) -> TextIO:
    if stream is None:
        return open(os.devnull, "w", encoding="utf-8")
    if os.name == "nt" and stream.isatty():  # a console of its own kind, and no pipe
        return stream
    raw = io.BufferedWriter(_Pipe(number, "w", closefd=False))
    return io.TextIOWrapper(raw, stream.encoding, "replace", line_buffering=stream.isatty())


class _Pipe(io.FileIO):
    """A stream that goes nowhere once its reader has gone, as after `| head`, or its disk is full.

    What a run has written is there all the same; of a full disk the other stream tells.
    """

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if not isinstance(error, BrokenPipeError) and self.fileno() == 1:
                say(f"mtpipe: what it says cannot be written ({error.strerror})", err=True)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return super().write(data)
