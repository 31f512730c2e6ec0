"""`mtpipe init`: what it prints and asks, and the file it writes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from mtpipe.cli.terminal import progress_bar, quoted
from mtpipe.ground.errors import MtpipeError, writing
from mtpipe.ground.files import write_atomically
from mtpipe.ground.streams import say, visible
from mtpipe.ingest.data_files import SETUP_NAME
from mtpipe.proposal.proposal import checked, propose
from mtpipe.proposal.questions import read_answers


@dataclass(frozen=True)
class Written:
    """The setup that was written, what `mtpipe run` is to be given, and what is left to do."""

    setup: Path
    target: Path
    left: str
    asked: bool

    @property
    def in_words(self) -> str:
        """Arguments of `mtpipe run`."""
        home = self.target if self.target.is_dir() else self.target.parent
        if self.setup in (self.target, home / SETUP_NAME):
            return quoted(self.target)
        return f"{quoted(self.target)} --setup {quoted(self.setup)}"

    def wants_run(self) -> bool:
        """Whether a person at the terminal wants a first run now."""
        return self.asked and typer.confirm("Run it now, without cross-check?", default=True)


def propose_and_write(
    files: Sequence[Path], setup: Path | None, answers: Path | None, *, overwrite: bool
) -> Written:
    """Propose a setup, write it, and read the recording with it."""
    folder = files[0] if files[0].is_dir() else files[0].parent
    place = setup or folder / SETUP_NAME
    asks = answers is None and sys.stdin.isatty() and sys.stdout.isatty()
    if place.exists() and not overwrite and not (asks and _replace(place)):
        raise typer.BadParameter(
            f"{visible(str(place))} is there already; --overwrite replaces it, --setup writes "
            "another file."
        )
    known = {} if answers is None else read_answers(answers)
    if asks:
        say('Press Enter for what stands in brackets; "unknown" is an answer.')
        proposal = propose(files, place, answers=known, ask=_ask)
    else:
        with progress_bar() as progress:
            proposal = propose(files, place, answers=known, progress=progress)
    for line in proposal.seen:
        say(line)
    if proposal.guesses:
        say("Guessed:")
    for line in proposal.guesses:
        say(f"  {line}")
    if proposal.unknown and not asks:
        say(f"Not known: {', '.join(proposal.unknown)}. Write what you know into the setup.")
    with writing(place, "--setup"):
        write_atomically(place, proposal.text)
    say(f"Setup: {place}")
    left = ""
    try:
        say(f"Done: with this setup mtpipe reads {checked(place, proposal.film)}.")
    except MtpipeError as error:
        left = str(error)
        say(f"Left for you: {left}", err=True)
    return Written(place, proposal.film or place, left, asks)


def _replace(place: Path) -> bool:
    return typer.confirm(f"{visible(str(place))} is there. Replace it?")


def _ask(text: str, default: str) -> str:
    return str(typer.prompt(visible(text), default=default))
