"""Headers that announce more numbers than their file can hold are refused before they are read.

A damaged header of a few bytes can ask for more memory than any computer has.
"""

from __future__ import annotations

from mtpipe.errors import RecordingError

# deflate makes at most 1032 bytes of one; other packings make more only of what has no content
MOST_UNPACKED = 1032
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
