"""Putting a person's answers into a draft, one question at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mtpipe.ground.errors import MtpipeError
from mtpipe.proposal.draft import Draft
from mtpipe.proposal.questions import parsed

# Asks a person: what, and the answer that is taken by Enter.
Ask = Callable[[str, str], str]


class Asking:
    """Puts a person's answers into a draft; without anybody to ask, what was guessed stays."""

    def __init__(self, draft: Draft, ask: Ask | None) -> None:
        self.draft, self.ask = draft, ask

    def about(self, key: str, text: str, guess: Any, why: str, *, certain: bool = False) -> None:
        """Put the guess for a key, or what a person says of it.

        certain : the guess is none, and nobody is asked.
        """
        if self.draft.states_some(key):
            return
        self.draft.put(key, guess, why, guess=not certain)
        if self.ask is None or certain:
            return
        shown = ", ".join(guess) or "none" if isinstance(guess, list) else f"{guess}"
        fault = ""
        while True:
            answer = self.ask(f"{fault}{text}", shown)
            if answer.strip() == shown:
                return
            try:
                self.draft.fix({key: parsed(key, answer)}, "your answer")
            except MtpipeError as error:
                fault = f"{error}. "
                continue
            return
