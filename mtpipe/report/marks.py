"""A reader's own marks: what of a run is left out by hand, and why (`marks.toml` beside its files).

A bead, a plateau of a bead, or a stretch of time of a bead. Beads and plateaus are left out
wherever a run is read (`mtpipe.report.marked`); a stretch counts as lost frames in the next
`mtpipe run`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.files import write_atomically
from mtpipe.ground.notice import Notice
from mtpipe.recording.recording import Recording
from mtpipe.setup.reference import as_toml

MARKS = "marks.toml"
HEAD = "# What a reader leaves out of this run; written by mtpipe mark or saved from the report.\n"


@dataclass(frozen=True)
class Mark:
    """What is left out: the bead, or one of its plateaus, or from `from_s` to `to_s` of it.

    Times are those of the recording, as `start_s` in forces.csv.
    """

    bead: str
    reason: str
    plateau: int | None = None
    from_s: float | None = None
    to_s: float | None = None

    @property
    def stretch_s(self) -> tuple[float, float] | None:
        """Begin and end, where it is a stretch of time."""
        return None if self.from_s is None or self.to_s is None else (self.from_s, self.to_s)

    @property
    def place(self) -> str:
        """What is left out, in words."""
        if self.stretch_s is not None:
            return f"{self.bead}, {self.stretch_s[0]:g} to {self.stretch_s[1]:g} s"
        return self.bead if self.plateau is None else f"{self.bead}, plateau {self.plateau}"

    def same_place(self, other: Mark) -> bool:
        """Whether it leaves out the same, for whatever reason."""
        return replace(self, reason="") == replace(other, reason="")


class MarkedPlace(BaseModel):
    """A `[[mark]]` of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    bead: str = Field(min_length=1)
    reason: str = Field(min_length=1)
    plateau: int | None = Field(default=None, ge=0)
    from_s: float | None = Field(default=None, allow_inf_nan=False)
    to_s: float | None = Field(default=None, allow_inf_nan=False)

    @model_validator(mode="after")
    def _is_one_place(self) -> MarkedPlace:
        if (self.from_s is None) != (self.to_s is None):
            raise ValueError("a stretch needs from_s and to_s")
        if self.from_s is not None and self.to_s is not None:
            if self.plateau is not None:
                raise ValueError("give a plateau, or a stretch from from_s to to_s, not both")
            if not self.from_s < self.to_s:
                raise ValueError(f"from_s = {self.from_s:g} is not before to_s = {self.to_s:g}")
        return self


class MarksFile(BaseModel):
    """`marks.toml`."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    version: Literal[1] = Field(alias="schema")
    mark: tuple[MarkedPlace, ...] = ()


def mark_of(**values: str | float | None) -> Mark:
    """A mark, checked.

    Raises
    ------
    MtpipeError : no such place can be.
    """
    try:
        return Mark(**MarkedPlace.model_validate(values).model_dump())
    except ValidationError as error:
        raise MtpipeError(_sentence(error), where="mark") from None


def read_marks(folder: Path) -> tuple[Mark, ...]:
    """The marks of a run folder; none where there is no `marks.toml`.

    Raises
    ------
    MtpipeError : the file cannot be read, or a mark in it cannot be.
    """
    path = folder / MARKS
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        return tuple(Mark(**one.model_dump()) for one in MarksFile.model_validate(content).mark)
    except FileNotFoundError:
        return ()
    except ValidationError as error:
        raise MtpipeError(_sentence(error), where=str(path)) from None
    except (OSError, ValueError, RecursionError) as error:
        raise MtpipeError(f"cannot be read ({error})", where=str(path)) from None


def write_marks(folder: Path, marks: Sequence[Mark]) -> None:
    """Write the marks of a run folder."""
    parts = [f"{HEAD}schema = 1\n"]
    for mark in marks:
        lines = [f"{k} = {as_toml(v)}" for k, v in asdict(mark).items() if v is not None]
        parts.append("\n".join(["[[mark]]", *lines, ""]))
    write_atomically(folder / MARKS, "\n".join(parts))


def without_stretches(recording: Recording, marks: Sequence[Mark]) -> Recording:
    """A recording whose marked stretches count as lost frames, with a notice of each."""
    positions, notices = dict(recording.positions_nm), list(recording.notices)
    for mark in marks:
        if mark.stretch_s is None or mark.bead not in positions:
            continue
        begin, end = mark.stretch_s
        inside = (recording.time_s >= begin) & (recording.time_s <= end)
        positions[mark.bead] = np.where(inside[:, None], np.nan, positions[mark.bead])
        said = f"From {begin:g} to {end:g} s it is left out by hand: {mark.reason}"
        notices.append(Notice("left_out_by_hand", "info", said, bead=mark.bead))
    return replace(recording, positions_nm=positions, notices=tuple(notices))


def _sentence(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"])
    said = first["msg"].removeprefix("Value error, ")
    return f"{place}: {said}" if place else said
