"""A recording whose files are still being written: what of it is whole.

The plateau that it ends in waits, as do rows after the last plateau that has ended. So what is
taken is the same whenever the files are looked at, until the next plateau has ended.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ingest import load
from mtpipe.ingest.data_files import find_recording
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import Setup
from mtpipe.setup.source_table import Source

GROWS = "being_recorded"
# A last row may be half written, and a number that is cut off is another number.
ROWS_OF_DOUBT = 1


def load_growing(path: Path, setup: Path) -> Recording:
    """Read a recording up to the end of the last plateau that has ended.

    Raises
    ------
    MtpipeError : it cannot be read as it is now, or no plateau has ended.
    """
    raw = load(path, _taking_what_is_whole(find_recording(path, setup).setup))
    sure = len(raw.time_s) - ROWS_OF_DOUBT
    ended = tuple(one for one in raw.plateaus if one.stop < sure)
    if not ended:
        raise RecordingError("no plateau has ended yet", where=raw.name)
    rows = slice(ended[-1].stop)
    said = (
        f"It was still being written when it was read: these are its first {len(ended)} plateaus. "
        "Whatever comes after them waits."
    )
    return replace(
        raw,
        time_s=raw.time_s[rows],
        frame=raw.frame[rows],
        positions_nm={bead: xyz[rows] for bead, xyz in raw.positions_nm.items()},
        magnet_mm=None if raw.magnet_mm is None else raw.magnet_mm[rows],
        magnet_turns=None if raw.magnet_turns is None else raw.magnet_turns[rows],
        plateaus=ended,
        notices=(
            Notice(GROWS, "caution", said),
            *(one for one in raw.notices if one.code != "file_incomplete"),
        ),
    )


def _taking_what_is_whole(setup: Setup) -> Setup:
    source = setup.source or Source()
    magnet = source.magnet
    if magnet is not None:
        magnet = magnet.model_copy(update={"incomplete": "take"})
    source = source.model_copy(update={"incomplete": "take", "magnet": magnet})
    return setup.model_copy(update={"source": source})
