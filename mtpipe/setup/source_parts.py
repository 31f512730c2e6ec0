"""The tables within the setup's `[source]` table: text, columns, units, clock, magnets, z = 0."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator, model_validator

Format = Literal["canonical", "text", "parquet", "matlab", "hdf5", "tdms", "npz", "npy", "gr"]
Delimiter = Literal["comma", "tab", "semicolon", "whitespace"]
NM_PER_UNIT = {"nm": 1.0, "um": 1e3, "mm": 1e6, "m": 1e9}
SECONDS_PER_UNIT = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "day": 86_400.0
}  # fmt: skip
TURNS_PER_UNIT = {"turn": 1.0, "degree": 1 / 360, "radian": 1 / (2 * math.pi)}
TAKE = 'To take what is whole, write incomplete = "take" into [source]'
NUMBER = "{n}"
NAME = "{name}"


def _column(value: Any) -> int | str:
    if isinstance(value, str) and value.strip():
        return value
    if isinstance(value, int) and not isinstance(value, bool) and value >= 1:
        return value
    raise ValueError(f"a column's name or its number, counted from 1, is needed; got {value!r}")


def _micro(value: Any) -> Any:
    return value.replace("µ", "u").replace("μ", "u") if isinstance(value, str) else value


def listed(value: Any) -> Any:
    """One thing as a list of one."""
    return [value] if isinstance(value, (str, dict)) else value


Column = Annotated[int | str, PlainValidator(_column)]
LengthUnit = Annotated[Literal["nm", "um", "mm", "m"], BeforeValidator(_micro)]
UNKNOWN_UNIT = "unknown"
PositionUnit = Annotated[
    Literal["nm", "um", "mm", "m", "pixel", "unknown"], BeforeValidator(_micro)
]
TimeUnit = Annotated[Literal["s", "ms", "us", "ns", "min", "h", "day"], BeforeValidator(_micro)]
Rows = tuple[int, int]


class Table(BaseModel):
    """Base of the tables: frozen, and a misspelt key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Layout(Table):
    """What kind of file it is and, for text, how it is written.

    `header` is whether a line of column names precedes the numbers; `skip_lines` lines before
    that are passed over, and so are lines that start with `comment` and empty ones. `incomplete`
    takes what is whole of a file that is cut off; `attributes = "setup"` puts aside what the file
    says of its numbers itself (unit, scale, rate).
    """

    format: Format | None = None
    delimiter: Delimiter | None = None
    decimal: Literal[".", ","] = "."
    encoding: str | None = None
    header: bool | None = None
    skip_lines: int = Field(default=0, ge=0)
    comment: str = "#"
    incomplete: Literal["take"] | None = None
    attributes: Literal["setup"] | None = None

    @model_validator(mode="after")
    def _is_possible(self) -> Layout:
        if self.delimiter == "comma" and self.decimal == ",":
            raise ValueError("delimiter and decimal mark cannot both be a comma")
        try:
            "".encode(self.encoding or "utf-8")
        except LookupError:
            raise ValueError(f"encoding: there is no encoding {self.encoding!r}") from None
        return self


class BeadColumns(Table):
    """Columns of one bead, or of many by a repeating pattern.

    Three forms: `name` with `x`, `y`, `z` for one bead; the same with `{n}` in names for every
    number n found; `first_column`, `order` and `names` for columns that repeat bead by bead
    (`order` such as "xyz", "_" for a column to pass over).
    """

    name: str | None = None
    x: Column | None = None
    y: Column | None = None
    z: Column | None = None
    names: tuple[str, ...] = ()
    first_column: Column | None = None
    order: str = "xyz"

    @property
    def axes(self) -> dict[str, int | str]:
        """Columns by axis, as far as they are named."""
        pairs = (("x", self.x), ("y", self.y), ("z", self.z))
        return {axis: column for axis, column in pairs if column is not None}

    @property
    def is_pattern(self) -> bool:
        """Whether the columns' names contain `{n}`."""
        return any(isinstance(c, str) and NUMBER in c for c in self.axes.values())

    @model_validator(mode="after")
    def _is_one_form(self) -> BeadColumns:
        if (self.first_column is not None) == bool(self.axes):
            raise ValueError("give either first_column, order and names, or x, y and z")
        if self.first_column is not None:
            axes = self.order.replace("_", "")
            if not re.fullmatch("[xyz_]+", self.order) or len(set(axes)) < max(1, len(axes)):
                raise ValueError(f'order: letters x, y, z once each and "_", got {self.order!r}')
            if self.name is not None:
                raise ValueError("first_column goes with names (a list), not with name")
        elif self.names:
            raise ValueError("names goes with first_column; a single bead has a name")
        elif self.is_pattern:
            if not all(isinstance(c, str) and NUMBER in c for c in self.axes.values()):
                raise ValueError("every column of a pattern needs {n}")
            if self.name is not None and NUMBER not in self.name:
                raise ValueError(f"name: {self.name!r} needs {{n}}, as its columns have it")
        elif self.name is None:
            raise ValueError("the bead needs a name")
        return self


class Units(Table):
    """Units of the positions; `position` holds for every axis that has none of its own.

    "unknown" is the unit that the file states. A pixel is `pixel_size_x_nm`, `pixel_size_y_nm` or
    else the camera's `pixel_size_nm`.
    """

    position: PositionUnit | None = None
    x: PositionUnit | None = None
    y: PositionUnit | None = None
    z: PositionUnit | None = None
    pixel_size_x_nm: float | None = Field(default=None, gt=0)
    pixel_size_y_nm: float | None = Field(default=None, gt=0)

    def of(self, axis: str) -> str | None:
        """Unit of an axis, None where the table gives none."""
        units = {"x": self.x, "y": self.y, "z": self.z}
        return units[axis] or self.position

    @model_validator(mode="after")
    def _z_has_no_pixels(self) -> Units:
        if self.z == "pixel":
            raise ValueError("z cannot be in pixels")
        return self


class Scale(Table):
    """Factors on the positions: z for the refraction at the surface, a minus sign to flip."""

    x: float = 1.0
    y: float = 1.0
    z: float = 1.0

    @model_validator(mode="after")
    def _is_no_zero(self) -> Scale:
        for axis in ("x", "y", "z"):
            factor = getattr(self, axis)
            if factor == 0 or not math.isfinite(factor):
                raise ValueError(f"{axis}: a factor of {factor} leaves no position")
        return self


class Time(Table):
    """The column of time stamps.

    `rounded`: stamps so coarse that neighbours may be equal; every row is then the next frame,
    and the stamps serve only for the frame rate. `restarts`: every file of a series begins at 0.
    """

    column: Column
    unit: TimeUnit
    rounded: bool = False
    restarts: bool = False


class Frame(Table):
    """The column of frame numbers; `restarts`: every file of a series begins anew."""

    column: Column
    restarts: bool = False


class Magnet(Layout):
    """Magnet position: a column of the recording, or with `time_column` a log with its own clock.

    The log is in `file` (beside the recording), else in the recording's own file; `{name}` in
    `file` is the name of the recording's file without its suffix. A log's time plus
    `clock_offset_s` is the recording's time. A `file` may have no clock but a row for every row of
    the recording (`row_by_row`). Positions become `scale` times the value plus `offset_mm`.
    """

    column: Column
    unit: LengthUnit = "mm"
    scale: float = 1.0
    offset_mm: float = 0.0
    file: str | None = None
    time_column: Column | None = None
    time_unit: TimeUnit = "s"
    clock_offset_s: float = 0.0
    row_by_row: bool = False

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
    """Rotation of the magnets; while it changes by more than `tolerance_turns` in `window_s`
    there is no plateau. `in_log`: the column is in the magnets' log."""

    column: Column
    unit: Literal["turn", "degree", "radian"]
    tolerance_turns: float = Field(default=0.01, gt=0)
    window_s: float = Field(default=0.5, gt=0)
    in_log: bool = False


class Lost(Table):
    """What means that the tracker lost a bead, beyond empty cells, NaN and infinite values.

    `tokens`: words in a text file; `values`: numbers in a position column;
    `all_zero_rows`: rows in which every position is 0, such as a start-up block.
    """

    tokens: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    all_zero_rows: bool = False


class ZZero(Table):
    """Where a bead's z is 0, in one of four ways.

    `value_nm`: the z that the file gives at the surface (after unit and scale); `touch_rows`
    or `touch_time_s`: a stretch in which the bead touches the surface; `unknown = true`.
    """

    value_nm: float | None = None
    touch_rows: Rows | None = None
    touch_time_s: tuple[float, float] | None = None
    unknown: Literal[True] | None = None

    @model_validator(mode="after")
    def _is_one_way(self) -> ZZero:
        if len(self.model_fields_set) != 1:
            raise ValueError("give one of value_nm, touch_rows, touch_time_s, unknown = true")
        for stretch in (self.touch_rows, self.touch_time_s):
            if stretch is not None and not stretch[0] < stretch[1]:
                raise ValueError(f"the stretch {list(stretch)} ends before it begins")
        return self
