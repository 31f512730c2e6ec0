"""A process that reads many inputs, one after another, within bounds of memory."""

from __future__ import annotations

import os
import resource
import shutil
import sys
import warnings
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import mkdtemp

import readers
from case import case_of

from mtpipe.ground.errors import MtpipeError

MEMORY_BYTES = 4 << 30
OUTCOMES = ("fine", "sentence", "other", "hang", "abort", "memory")
BAD = OUTCOMES[2:]


def serve(connection: Connection) -> None:
    """Take names of readers and numbers of inputs; answer "begun", then (outcome, what is said)."""
    silent = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # libraries in C write there
        os.dup2(silent, stream)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")
    folder = Path(mkdtemp(prefix="fuzz"))
    connection.send(str(folder))
    while True:
        name, number = connection.recv()
        place = folder / "input"
        try:
            path = (case := case_of(readers.BY_NAME[name], number)).write(place)
        except Exception as error:
            connection.send(f"{name} {number} is not made: {told(error)}")
            raise
        connection.send("begun")
        answers = [judged(step) for step in readers.BY_NAME[name].steps(path, case)]
        shutil.rmtree(place, ignore_errors=True)
        connection.send(next((a for a in answers if a[0] in BAD), answers[0]))


def judged(step: object) -> tuple[str, str]:
    """What comes of one step of reading."""
    assert callable(step)
    try:
        step()
    except MtpipeError as error:
        if _for_memory(error):
            return "memory", told(error)
        if len(str(error).splitlines()) != 1:
            return "other", f"not one line: {str(error)!r}"
        return "sentence", str(error)
    except BaseException as error:
        return ("memory" if _for_memory(error) else "other"), told(error)
    return "fine", ""


def _for_memory(error: BaseException | None) -> bool:
    """Whether an error began as one of memory that is not there."""
    while error is not None:
        words = str(error)
        if isinstance(error, MemoryError) or any(w in words for w in ("MemoryError", "malloc of")):
            return True
        error = error.__cause__ or error.__context__
    return False


def told(error: BaseException) -> str:
    """Type, text and innermost place in mtpipe."""
    import traceback

    frames = traceback.extract_tb(error.__traceback__)
    inner = [f for f in frames if f"{os.sep}mtpipe{os.sep}" in f.filename] or frames[-1:]
    place = f"{Path(inner[-1].filename).name}:{inner[-1].lineno}" if inner else ""
    return f"{type(error).__name__} at {place}: {str(error)[:300]!r}"


if __name__ == "__main__":
    sys.exit("is started by study.py")
