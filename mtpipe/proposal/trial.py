"""Reading a recording with a drafted setup, and mending what reading says against the draft.

The readers of `ingest` refuse what would give a wrong force, each time with its reason. Where the
reason names a key that no person has to decide, the key is set, said, and reading tried again.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from mtpipe.ground.errors import MtpipeError
from mtpipe.ingest.read import read_recording
from mtpipe.proposal.draft import Draft
from mtpipe.proposal.questions import put_usual
from mtpipe.recording.recording import Recording
from mtpipe.setup.measured import UNKNOWN
from mtpipe.setup.setup import parse_setup

MOST_MENDED = 8
# Any, where the files tell none: motions are compared, and none is given in numbers.
STAND_IN_HZ = 100.0
NO_RATE = "the frame rate is unknown, and the recording has no time stamps"


@dataclass(frozen=True, eq=False)
class FirstReading:
    """A recording read with a draft; `rate_words` say where the frame rate is from, if anywhere."""

    recording: Recording
    rate_known: bool
    rate_words: str


def first_reading(draft: Draft, target: Path) -> FirstReading:
    """Read a recording to see its beads move: all tethered, one plateau, z as it stands.

    Parameters
    ----------
    draft : gains the keys that reading shows to be needed.
    target : file or folder of the recording.

    Raises
    ------
    MtpipeError : it cannot be read with this draft, and no key of ours would change that.
    """
    for _ in range(MOST_MENDED):
        trial = draft.copied()
        trial.fixed.clear()
        put_usual(trial)
        trial.put("field.direction", "x")
        if trial.get("source.beads") is not None or trial.get("source.preset") is not None:
            trial.drop("source.z_zero")
            trial.put("source.z_zero", {"unknown": True})
        # references are looked for, and the exposure cannot be longer than a frame not yet known
        trial.put("beads.reference", [])
        trial.put("camera.exposure_s", UNKNOWN)
        trial.put("tether.contour_length_nm", UNKNOWN)
        trial.put("plateaus.minimum_s", 1e-6)
        trial.put("plateaus.settle_s", 0.0)
        trial.put("plateaus.tolerance_mm", 1e9)
        if trial.get("camera.frame_rate_hz") is None:
            trial.put("camera.frame_rate_hz", UNKNOWN)
        if trial.get("camera.pixel_size_nm") == UNKNOWN:
            trial.put("camera.pixel_size_nm", 1.0)
        try:
            return _read(trial, target)
        except MtpipeError as error:
            if not _mended(draft, error.message):
                raise
    raise AssertionError("a draft that is mended without end")


def _read(trial: Draft, target: Path) -> FirstReading:
    try:
        recording = read_recording(target, parse_setup(trial.content))
        derived = [n.message for n in recording.notices if n.code == "frame_rate_derived"]
        words = "from the time stamps" if "stamps" in "".join(derived) else "as the file says"
        return FirstReading(recording, True, words)
    except MtpipeError as error:
        if not error.message.startswith(NO_RATE):
            raise
    trial.put("camera.frame_rate_hz", STAND_IN_HZ)
    return FirstReading(read_recording(target, parse_setup(trial.content)), False, "")


def _mended(draft: Draft, message: str) -> bool:
    """Set the key that an error of reading asks for; False where there is none."""
    word = re.match(r"'([^'\d]+)' is no number", message)
    if word and draft.get("source.lost.tokens") != [word[1]]:
        tokens = [*(draft.get("source.lost.tokens") or []), word[1]]
        draft.put("source.lost.tokens", tokens, "words among the numbers", guess=True)
        return len(set(tokens)) == len(tokens)
    if "every position is exactly 0" in message and not draft.get("source.lost.all_zero_rows"):
        draft.put("source.lost.all_zero_rows", True, "rows of zeros are no positions", guess=True)
        return True
    if re.match("the (time|frame number)", message):
        return _mended_clock(draft, message)
    if "is cut off" in message and draft.get("source.incomplete") is None:
        draft.put(
            "source.incomplete", "take", "a file is cut off: what is whole is taken", guess=True
        )
        return True
    return False


def _mended_clock(draft: Draft, message: str) -> bool:
    which = "frame" if message.startswith("the frame number") else "time"
    if draft.get(f"source.{which}") is None:
        return False
    if which == "time" and "occurs twice" in message and not draft.get("source.time.rounded"):
        draft.put("source.time.rounded", True, "stamps repeat, so every row is a frame", guess=True)
        return True
    draft.drop(f"source.{which}")
    return True
