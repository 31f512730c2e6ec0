"""Notices: what a user must be told about a recording or a result, in words.

A notice travels with the recording into the report and `run.json`. An error that would make a
force wrong is not a notice but a `MtpipeError`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mtpipe.ground.files import as_text, in_one_line

Severity = Literal["info", "caution", "warning"]


@dataclass(frozen=True)
class Notice:
    """One sentence about the recording, or about one bead, plateau or axis of it.

    `code` is a short identifier (`lost_frames`, `no_reference`), stable across versions, used in
    the `flags` column of `forces`. `severity`: "info" (a choice or guess that was made),
    "caution" (look before you trust), "warning" (a number is likely affected).
    """

    code: str
    severity: Severity
    message: str
    bead: str | None = None
    plateau: int | None = None
    axis: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "message", in_one_line(as_text(self.message)))
