"""A setup proposed for a laboratory's files: the steps in their order.

Files are looked at, the layout is drafted, the recording read with it, and what the beads' motion
tells is added; what no file tells is asked, or written as usual or unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mtpipe.ground.errors import RecordingError, SetupError
from mtpipe.ground.files import as_text
from mtpipe.ground.types import NamedProgress
from mtpipe.ingest import load
from mtpipe.proposal.asking import Ask, Asking
from mtpipe.proposal.draft import Draft
from mtpipe.proposal.laboratory_files import film_of
from mtpipe.proposal.questions import ALWAYS, put_usual
from mtpipe.proposal.table import propose_table
from mtpipe.proposal.text import said, setup_text
from mtpipe.setup.measured import UNKNOWN
from mtpipe.setup.setup import read_setup
from mtpipe.tracking.stack import open_stack

HEAD = (
    "Proposed by `mtpipe init` from {files}. Remarks say what was guessed: look at them.\n"
    "What a key means: mtpipe explain KEY, for instance mtpipe explain source.magnet"
)


@dataclass(frozen=True)
class Proposal:
    """What is proposed.

    Attributes
    ----------
    text : of the setup. guesses : one sentence each. seen : what was found, a line each.
    unknown : keys that no file tells and nobody answered.
    film : what `mtpipe run` is to be given beside the setup; None: the setup names its files.
    """

    text: str
    guesses: tuple[str, ...]
    seen: tuple[str, ...]
    unknown: tuple[str, ...]
    film: Path | None


def propose(
    paths: Sequence[Path],
    setup_file: Path,
    *,
    answers: Mapping[str, Any] | None = None,
    ask: Ask | None = None,
    progress: NamedProgress | None = None,
) -> Proposal:
    """Propose a setup for a recording.

    Parameters
    ----------
    paths : its file or files, or their folder; the magnets' log may be among them or beside.
    setup_file : where the setup will be, which its file names are relative to.
    answers : a part of a setup that is right.
    ask : asks a person; None where nobody is there.
    progress : called with (step, done, of how many).

    Raises
    ------
    MtpipeError : there is no recording in the files, or it cannot be read.
    """
    say = progress or (lambda step, done, total: None)
    draft = Draft()
    draft.fix(answers or {}, "your answer")
    asking = Asking(draft, ask)
    film = film_of(paths)
    if film is None:
        seen = propose_table(paths, setup_file.parent, draft, asking, say)
    else:
        from mtpipe.proposal.film import propose_film

        seen = propose_film(film, setup_file.parent, draft, asking, say)
    for question in ALWAYS:
        told = draft.get(question.key)  # by a file's remarks
        if told is not None:
            asking.about(question.key, question.text, told, draft.why[question.key])
            continue
        asking.about(question.key, question.text, question.usual, question.why)
        if question.key in draft.guessed:
            draft.guessed.remove(question.key)  # nothing was guessed, and the setup says so
    put_usual(draft)
    files = ", ".join(as_text(path.name or str(path.resolve().name)) for path in paths[:3])
    return Proposal(
        setup_text(draft, HEAD.format(files=files)),
        tuple(said(draft)),
        tuple(seen),
        tuple(question.key for question in ALWAYS if draft.get(question.key) == UNKNOWN),
        None if film is None else film.path,
    )


def checked(setup_file: Path, film: Path | None) -> str:
    """Read the recording with the setup as it was written, as `mtpipe run` would; in words.

    Of a film the setup is read, and the film was looked at already.

    Raises
    ------
    MtpipeError : setup or recording are refused.
    """
    if film is not None:
        setup = read_setup(setup_file)
        timed = setup.tracking.times is None and open_stack(film).stamps is not None
        if setup.camera.frame_rate_hz.value is None and not timed:
            raise SetupError(
                "[camera] frame_rate_hz is unknown, and the film has no time stamps",
                where=str(setup_file),
                mend="Write how many frames the camera took per second.",
            )
        return "the film"
    recording = load(setup_file)
    flat = [b for b in recording.tethered if np.isnan(recording.positions_nm[b][:, :2]).all()]
    if flat:
        raise RecordingError(
            f"x and y of {', '.join(flat[:6])} were not found, and the force comes from them",
            where=str(setup_file),
            mend="Say which columns they are in [source] beads: mtpipe explain source.beads",
        )
    counts = {
        "tethered bead": len(recording.tethered),
        "reference bead": len(recording.references),
        "plateau": len(recording.plateaus),
    }
    beads, references, plateaus = (f"{n} {one}{'s' * (n != 1)}" for one, n in counts.items())
    rate = recording.setup.camera.frame_rate_hz.value
    return f"{beads}, {references} and {plateaus} at {rate:.6g} Hz"
