"""Numbers that cannot be: more than their file can hold, or more than fit into the memory.

A header of a few bytes can ask for more memory than any computer has, and a small file that repeats
one value unfold to it. Both are refused before anything is read.
"""

from __future__ import annotations

import os
from pathlib import Path

from mtpipe.ground.errors import RecordingError

# deflate makes at most 1032 bytes of one; other packings make more only of what has no content
MOST_UNPACKED = 1032
# Positions are held as they were read, and once more with the drift taken off.
HELD_TIMES = 2
NUMBER_BYTES = 8
# The memory that a container may have, where it is bounded (Linux, control groups).
BOUND_OF_CONTAINER = Path("/sys/fs/cgroup/memory.max")
LESS = "Take a part of it, fewer beads, or a computer with more memory."
# What is smaller than this does no harm, whatever its header says.
HARMLESS_BYTES = 1 << 26


def check_announced(announced: int, held: int, packed: bool, where: str) -> None:
    """Raise RecordingError if data cannot be as long as their header says.

    Parameters
    ----------
    announced, held : bytes that the header announces, and bytes in the file that are to hold them.
    packed : whether they are compressed; else both have to be the same.
    """
    most = max(held * MOST_UNPACKED, HARMLESS_BYTES) if packed else held
    if announced > most:
        raise RecordingError(
            f"announces {announced:.3g} bytes of numbers, of which the file holds "
            f"{held}{' packed ones' if packed else ''}: it is cut off or damaged",
            where=where,
            mend="Copy the file again.",
        )


def check_fits(numbers: int, where: str) -> None:
    """Raise RecordingError if a recording of this size cannot be held in memory.

    Parameters
    ----------
    numbers : rows times columns that are read.
    """
    _check_memory(numbers * NUMBER_BYTES * HELD_TIMES, f"{numbers:.3g} numbers", where)


def check_room(size: int, where: str) -> None:
    """Raise RecordingError if what a library unfolds at once cannot be held in memory.

    Parameters
    ----------
    size : bytes of it.
    """
    _check_memory(size, f"{size:.3g} bytes at once", where)


def _check_memory(needed: int, what: str, where: str) -> None:
    memory = memory_bytes()
    if memory is not None and needed > memory:
        said = f"{needed / 1e9:.3g} GB of memory; there are {memory / 1e9:.3g} GB"
        raise RecordingError(f"unfolds to {what}, which need {said}", where=where, mend=LESS)


def no_room(where: str) -> RecordingError:
    """The error for what asked for more memory than other programs left."""
    return RecordingError("needs more memory than is free", where=where, mend=LESS)


def memory_bytes() -> int | None:
    """Memory of computer, container and process; None where the system does not tell."""
    if not hasattr(os, "sysconf"):
        return None
    import resource  # which only these systems have

    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    process, _ = resource.getrlimit(resource.RLIMIT_AS)
    if process != resource.RLIM_INFINITY:
        memory = min(memory, process)
    try:
        bound = BOUND_OF_CONTAINER.read_text().strip()
    except OSError:
        return memory
    return min(memory, int(bound)) if bound.isdecimal() else memory
