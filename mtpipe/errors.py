"""Exceptions of mtpipe: each carries one plain sentence and where it applies.

Everything a user can cause derives from `MtpipeError`; the command line prints its text and exits,
never a traceback. Anything else that escapes is a defect of mtpipe.
"""

from __future__ import annotations


class MtpipeError(Exception):
    """Base of all errors that a user can cause and mend.

    Parameters
    ----------
    message : what is wrong, in one sentence.
    where : file, line, column or key it concerns; printed before the message.
    mend : how to put it right; printed after the message.
    """

    def __init__(self, message: str, *, where: str | None = None, mend: str | None = None) -> None:
        self.message = message
        self.where = where
        self.mend = mend
        super().__init__(message)

    def __str__(self) -> str:
        head = f"{self.where}: " if self.where else ""
        if not self.mend:
            return f"{head}{self.message}"
        end = "" if self.message.endswith((".", "!", "?")) else "."
        return f"{head}{self.message}{end} {self.mend}"


class SetupError(MtpipeError):
    """The setup is not valid; `where` names file and key."""


class RecordingError(MtpipeError):
    """The recording cannot be read, or going on would give a wrong force."""


class FitError(MtpipeError):
    """A trace or a curve cannot be fitted; the message says why."""
