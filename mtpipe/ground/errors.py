"""Exceptions of mtpipe: each carries one plain sentence and where it applies.

Everything a user can cause derives from `MtpipeError`; the command line prints its text and exits,
never a traceback. Anything else that escapes is a defect of mtpipe.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

from mtpipe.ground.files import as_text, in_one_line


class MtpipeError(Exception):
    """Base of all errors that a user can cause and mend.

    Parameters
    ----------
    message : what is wrong, in one sentence.
    where : file, line, column or key it concerns; printed before the message.
    mend : how to put it right; printed after the message.

    Attributes
    ----------
    exit_code : of the command that ends with it: 1 for data that cannot be processed, 2 for a
        call that was wrong.
    """

    exit_code: ClassVar[int] = 1

    def __init__(self, message: str, *, where: str | None = None, mend: str | None = None) -> None:
        self.message = in_one_line(as_text(message))
        self.where = None if where is None else as_text(where)
        self.mend = None if mend is None else as_text(mend)
        super().__init__(self.message)

    def __str__(self) -> str:
        head = f"{self.where}: " if self.where else ""
        if not self.mend:
            return in_one_line(f"{head}{self.message}")
        end = "" if self.message.endswith((".", "!", "?")) else "."
        return in_one_line(f"{head}{self.message}{end} {self.mend}")


class SetupError(MtpipeError):
    """The setup is not valid; `where` names file and key."""


class NoSetupError(SetupError):
    """There is no setup file where the call says, or leaves it to be, that one is."""

    exit_code = 2


class RecordingError(MtpipeError):
    """The recording cannot be read, or going on would give a wrong force."""


class FitError(MtpipeError):
    """A trace or a curve cannot be fitted; the message says why."""


def unforeseen(error: Exception) -> str:
    """The sentence for an error that no other sentence foresaw."""
    if isinstance(error, MemoryError):
        asked = f" ({error})" if str(error) else ""
        return f"the memory is not enough{asked}. Use fewer --workers, or more memory."
    if isinstance(error, OSError) and error.errno is not None:
        name = f"{error.filename}: " if error.filename else ""
        what = "no access" if isinstance(error, PermissionError) else "cannot be read or written"
        return f"{name}{what} ({error.strerror})"
    return (
        f"a defect of mtpipe itself: {type(error).__name__}: {error}\n"
        "Set MTPIPE_DEBUG=1 to see where, and please report it."
    )


class WorkerEndedError(MtpipeError):
    """A process that did the work was ended from outside."""


@contextmanager
def writing(place: Path, option: str = "--out") -> Iterator[None]:
    """Turn what the system says against writing a file or folder into a sentence.

    What it says of another file, such as one that is read, passes.
    """
    try:
        yield
    except OSError as error:
        other = error.filename is not None and not _belongs(Path(str(error.filename)), place)
        if error.errno is None or other:
            raise
        raise MtpipeError(
            f"cannot be written ({error.strerror})",
            where=str(place),
            mend=f"Make room or choose another {option}.",
        ) from None


def _belongs(file: Path, place: Path) -> bool:
    """Whether a file is the one at `place`, in the folder there, or its temporary neighbour."""
    return file.is_relative_to(place) or file.name.startswith(f".{place.name}")
