"""Units in which the file and the setup contradict each other, and what the numbers say to that.

Where a tethered bead can move so by the setup's unit alone, or time stamps agree with the camera's
rate by it alone, the file's word is wrong: its unit is told and put aside. Else nothing says which
of the two is right, and every force hangs on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ingest.checks import unlike_a_tether
from mtpipe.ingest.clock import UNIT_FACTOR
from mtpipe.ingest.collect import Collected
from mtpipe.recording.recording import AXES
from mtpipe.setup.setup import Setup
from mtpipe.setup.source_parts import NM_PER_UNIT, SECONDS_PER_UNIT

NM = {**NM_PER_UNIT, "cm": 1e7, "angstrom": 0.1}
ASIDE = 'If the file is wrong, write attributes = "setup" into [source].'


@dataclass(frozen=True)
class Contradiction:
    """One column, with its unit by the file and by the setup.

    Attributes
    ----------
    name : of the column; `what` it is: "b1 x", "time", "magnet".
    words : how the file says it; `key` where the setup does.
    """

    name: str
    what: str
    by_file: str
    by_setup: str
    words: str
    key: str
    where: str

    def refused(self) -> RecordingError:
        """The error."""
        return RecordingError(
            f"column {self.name} ({self.what}) is in {self.by_file} by the file ({self.words}), in "
            f"{self.by_setup} by the setup ({self.key})",
            where=self.where,
            mend=f"Correct {self.key}. {ASIDE}",
        )


def contradiction_notices(
    contradictions: Sequence[Contradiction], data: Collected, setup: Setup
) -> tuple[Notice, ...]:
    """What is to be said where the numbers show that the setup's unit is right.

    Raises
    ------
    RecordingError : they do not show it.
    """
    pairs: dict[tuple[str, str, str], list[Contradiction]] = {}
    for one in contradictions:
        pairs.setdefault((one.by_file, one.by_setup, one.words), []).append(one)
    notices = []
    for (by_file, by_setup, words), columns in pairs.items():
        why = _why_the_setup(columns, data, setup)
        if not why:
            raise columns[0].refused()
        names = ", ".join(dict.fromkeys(one.name for one in columns))
        said = (
            f"By the file ({words}) {names} would be in {by_file}, by the setup in {by_setup}, "
            f"which is taken: {why}."
        )
        notices.append(Notice("unit_contradicts", "caution", said))
    return tuple(dict.fromkeys(notices))


def _why_the_setup(columns: Sequence[Contradiction], data: Collected, setup: Setup) -> str:
    """Why the setup's unit is the right one of some columns, "" where that is not seen."""
    whats = {one.what for one in columns}
    by_file, by_setup = columns[0].by_file, columns[0].by_setup
    if whats == {"time"}:
        rate_hz, stamps = setup.camera.frame_rate_hz.value, data.time_s
        if rate_hz is None or stamps is None or len(stamps) < 2:
            return ""
        ratio = float(np.median(np.diff(stamps))) * rate_hz
        agree = 1 / UNIT_FACTOR < ratio < UNIT_FACTOR
        known = by_file in SECONDS_PER_UNIT
        return "only so the stamps agree with the camera's rate" if agree and known else ""
    right = wrong = 0
    for bead, xyz in data.positions_nm.items():
        for axis, column in zip(AXES, xyz.T, strict=True):
            if f"{bead} {axis}" not in whats or bead in setup.beads.reference:
                continue
            if by_file not in NM or by_setup not in NM or np.isnan(column).all():
                continue
            as_file = unlike_a_tether(column * (NM[by_file] / NM[by_setup]), setup)
            as_setup = unlike_a_tether(column, setup)
            right += bool(as_file) and not as_setup
            wrong += bool(as_setup) and not as_file
    return "only so tethered beads can move as they do" if right and not wrong else ""
