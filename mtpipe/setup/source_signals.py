"""Tables within `[source]` beside the beads' columns: clock, magnets, lost frames, z = 0."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from mtpipe.setup.source_parts import NAME, Column, Layout, LengthUnit, Rows, Table, TimeUnit


class Time(Table):
    """The column of time stamps."""

    column: Column = Field(
        description="Column of the time stamps. Clock times are read as such, whatever the "
        "unit says.",
        examples=["time"],
    )
    unit: TimeUnit = Field(description="Unit of the time stamps.", examples=["ms"])
    rounded: bool = Field(
        default=False,
        description="The stamps are so coarse that neighbours may be equal. Every row is then "
        "the next frame, and the stamps give only the frame rate.",
        examples=[True],
    )
    restarts: bool = Field(
        default=False, description="Every file of a series begins at 0.", examples=[True]
    )


class Frame(Table):
    """The column of frame numbers."""

    column: Column = Field(
        description="Column of the frame numbers: time is number over frame rate.", examples=[1]
    )
    restarts: bool = Field(
        default=False,
        description="The numbers start again in every file.",
        examples=[True],
    )


class Magnet(Layout):
    """Magnet position: a column of the recording, or a log of its own.

    It is a log with `time_column` or with `row_by_row`.
    """

    column: Column = Field(description="Column of the magnet position.", examples=["zmag"])
    unit: LengthUnit = Field(
        default="mm", description="Unit of the magnet position.", examples=["mm"]
    )
    scale: float = Field(default=1.0, description="Factor on the magnet position.", examples=[-1.0])
    offset_mm: float = Field(
        default=0.0, description="Added to the magnet position after the factor.", examples=[12.5]
    )
    file: str | None = Field(
        default=None,
        description="File of a log, beside the recording. {name} is the name of the "
        "recording's file without its suffix. Default: the recording's own file.",
        examples=["{name}_motors.txt"],
    )
    time_column: Column | None = Field(
        default=None,
        description="Column of the log's own clock. Positions are then interpolated to the frames.",
        examples=[1],
    )
    time_unit: TimeUnit = Field(
        default="s", description="Unit of the log's clock.", examples=["ms"]
    )
    clock_offset_s: float = Field(
        default=0.0, description="The log's time plus this is the recording's time.", examples=[0.2]
    )
    row_by_row: bool = Field(
        default=False,
        description="The file has no clock, but a row for every row of the recording.",
        examples=[True],
    )

    @property
    def is_log(self) -> bool:
        """Whether the positions stand apart from those of the beads."""
        return self.time_column is not None or self.row_by_row

    def logs(self, files: Sequence[Path], folder: Path) -> list[Path]:
        """Files that the log is in, given the recording's own."""
        if self.file is None:
            return list(files)
        if NAME not in self.file:
            return [folder / self.file]
        stems = [Path(f.name.removesuffix(".gz")).stem for f in files]
        named = zip(files, stems, strict=True)
        return [file.parent / self.file.replace(NAME, stem) for file, stem in named]

    @model_validator(mode="after")
    def _log_has_a_clock(self) -> Magnet:
        if self.row_by_row and (self.file is None or self.time_column is not None):
            raise ValueError("row_by_row goes with file, and without time_column")
        if self.file is not None and not self.is_log:
            raise ValueError(
                "time_column is missing: a log in its own file needs its own clock, or "
                "row_by_row = true if it has a row for every row of the recording"
            )
        return self


class Rotation(Table):
    """Rotation of the magnets, during which there is no plateau."""

    column: Column = Field(description="Column of the magnets' rotation.", examples=[4])
    unit: Literal["turn", "degree", "radian"] = Field(
        description="Unit of the rotation.", examples=["turn"]
    )
    tolerance_turns: float = Field(
        default=0.01,
        gt=0,
        description="While the rotation changes by more than this within window_s there is no "
        "plateau.",
        examples=[0.02],
    )
    window_s: float = Field(
        default=0.5, gt=0, description="Stretch of time for tolerance_turns.", examples=[1.0]
    )
    in_log: bool = Field(
        default=False, description="The column is in the magnets' log.", examples=[True]
    )


class Lost(Table):
    """What means that the tracker lost a bead, beyond what always does."""

    tokens: tuple[str, ...] = Field(
        default=(),
        description='Words of a text file that mean lost. Every spelling of "not a number", '
        "empty cells and infinity always do.",
        examples=[["LOST"]],
    )
    values: tuple[float, ...] = Field(
        default=(), description="Numbers in position columns that mean lost.", examples=[[-1.0]]
    )
    all_zero_rows: bool = Field(
        default=False,
        description="Rows with every position 0 are lost, such as a start-up block.",
        examples=[True],
    )


class ZZero(Table):
    """Where a bead's z is 0: exactly one of four keys, and `no_plateau` beside a stretch."""

    value_nm: float | None = Field(
        default=None,
        description="The z that the file gives at the surface, after unit and scale.",
        examples=[350.0],
    )
    touch_rows: Rows | None = Field(
        default=None,
        description="First and last row, counted from 1, of a stretch in which the bead "
        "touches the surface.",
        examples=[[239516, 253575]],
    )
    touch_time_s: tuple[float, float] | None = Field(
        default=None,
        description="Begin and end of a stretch in which the bead touches the surface.",
        examples=[[10.0, 40.0]],
    )
    unknown: Literal[True] | None = Field(
        default=None,
        description="z stays as it stands, and the extension is unknown.",
        examples=[True],
    )

    no_plateau: bool = Field(
        default=False,
        description="A rest of the magnets that lies in the stretch by more than half is no "
        "plateau: a bead on the surface has no force to measure.",
        examples=[True],
    )

    @model_validator(mode="after")
    def _is_one_way(self) -> ZZero:
        if len(self.model_fields_set - {"no_plateau"}) != 1:
            raise ValueError("give one of value_nm, touch_rows, touch_time_s, unknown = true")
        for stretch in (self.touch_rows, self.touch_time_s):
            if stretch is not None and not stretch[0] < stretch[1]:
                raise ValueError(f"the stretch {list(stretch)} ends before it begins")
        return self
