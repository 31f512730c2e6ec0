"""Tables within the setup's `[source]` table: how text is written, columns of beads, units."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator, model_validator

Format = Literal[
    "canonical", "text", "parquet", "matlab", "hdf5", "netcdf", "tdms", "npz", "npy", "gr"
]
Delimiter = Literal["comma", "tab", "semicolon", "pipe", "whitespace"]
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
    """What kind of file it is and, for text, how it is written."""

    format: Format | None = Field(
        default=None,
        description="Kind of file: matlab is v4 to v7, hdf5 also MATLAB v7.3 and netCDF 4, netcdf "
        "version 3, gr PicoTwist plots. Default: told by how the file begins, not by its suffix.",
        examples=["text"],
    )
    delimiter: Delimiter | None = Field(
        default=None,
        description='What separates columns of text. "whitespace" is any run of blanks. '
        "Default: found by content.",
        examples=["tab"],
    )
    decimal: Literal[".", ","] = Field(
        default=".", description="Decimal mark of text.", examples=[","]
    )
    encoding: str | None = Field(
        default=None,
        description="Encoding of text. Default: the file's byte-order mark, UTF-8, or tried "
        "and named in the report.",
        examples=["latin-1"],
    )
    header: bool | None = Field(
        default=None,
        description="Whether a line of column names precedes the numbers. Default: found by "
        "content.",
        examples=[False],
    )
    skip_lines: int = Field(
        default=0, ge=0, description="Lines to pass over before that.", examples=[3]
    )
    comment: str = Field(
        default="#",
        description="Lines of text that begin with this are passed over, between rows too.",
        examples=["%"],
    )
    incomplete: Literal["take"] | None = Field(
        default=None,
        description='"take" takes what is whole of a file that is cut off. Default: such a '
        "file is refused.",
        examples=["take"],
    )
    attributes: Literal["setup"] | None = Field(
        default=None,
        description='"setup" puts aside what the file says of its numbers itself: unit, '
        "scale, rate.",
        examples=["setup"],
    )

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

    name: str | None = Field(
        default=None,
        description="Name of the bead; with {n} for every number n that is found.",
        examples=["bead{n}"],
    )
    x: Column | None = Field(
        default=None,
        description="Column of x. An axis that is left out was not recorded.",
        examples=["X{n} (um)"],
    )
    y: Column | None = Field(default=None, description="Column of y.", examples=["Y{n} (um)"])
    z: Column | None = Field(default=None, description="Column of z.", examples=["Z{n} (um)"])
    names: tuple[str, ...] = Field(
        default=(),
        description="Names of the beads whose columns repeat; goes with first_column.",
        examples=[["ref1", "b1"]],
    )
    first_column: Column | None = Field(
        default=None,
        description="First column of beads whose columns repeat bead by bead.",
        examples=[3],
    )
    order: str = Field(
        default="xyz",
        description='Order of the repeating columns. "_" passes over one.',
        examples=["xyz_"],
    )

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
    """Units of the positions."""

    position: PositionUnit | None = Field(
        default=None,
        description='Unit of every axis that has none of its own. "unknown": the one that the '
        "file states.",
        examples=["um"],
    )
    x: PositionUnit | None = Field(default=None, description="Unit of x.", examples=["pixel"])
    y: PositionUnit | None = Field(default=None, description="Unit of y.", examples=["pixel"])
    z: PositionUnit | None = Field(
        default=None, description="Unit of z; not pixels.", examples=["um"]
    )
    pixel_size_x_nm: float | None = Field(
        default=None,
        gt=0,
        description="Size of a pixel along x. Default: camera.pixel_size_nm.",
        examples=[64.6],
    )
    pixel_size_y_nm: float | None = Field(
        default=None,
        gt=0,
        description="Size of a pixel along y. Default: camera.pixel_size_nm.",
        examples=[64.7],
    )

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
    """Factors on the positions."""

    x: float = Field(
        default=1.0, description="Factor on x. A minus sign flips the axis.", examples=[-1.0]
    )
    y: float = Field(default=1.0, description="Factor on y.", examples=[-1.0])
    z: float = Field(
        default=1.0,
        description="Factor on z, for the refraction at the surface; a minus sign where z "
        "falls as beads rise.",
        examples=[0.878],
    )

    @model_validator(mode="after")
    def _is_no_zero(self) -> Scale:
        for axis in ("x", "y", "z"):
            factor = getattr(self, axis)
            if factor == 0 or not math.isfinite(factor):
                raise ValueError(f"{axis}: a factor of {factor} leaves no position")
        return self
