"""The setup: what a laboratory states about an experiment (`setup.toml`, FORMATS section 2).

Plain frozen data, validated on reading, every fault named by its key. A measurable value is a
`Measured`: with a standard error where the file gives `<name>_stderr`, and without a value where
the file says "unknown". Nothing has a default that a user can measure.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from mtpipe.ground.errors import NoSetupError, SetupError
from mtpipe.ground.shown import html_of
from mtpipe.setup.measured import UNKNOWN, Section, is_measured
from mtpipe.setup.source_table import Source
from mtpipe.setup.tables import (
    Beads,
    Buffer,
    Camera,
    DriftChoice,
    FieldAxis,
    Magnet,
    Magnets,
    Model,
    Plateaus,
    ReportChoice,
    Tether,
)
from mtpipe.setup.tracking_table import Tracking

if TYPE_CHECKING:
    import pandas as pd

PROPOSED = "`mtpipe init` looks at a recording and proposes one"


class Setup(BaseModel):
    """A whole setup."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)
    version: Literal[1] = Field(
        alias="schema",
        description="Version of the format: 1. It stands before all tables.",
        examples=[1],
    )
    camera: Camera = Field(description="Frame rate, shutter time and pixels of the camera.")
    beads: Beads = Field(
        description="Radius of the beads, and which of them are fixed to the surface."
    )
    tether: Tether = Field(description="The molecule: contour and persistence length.")
    buffer: Buffer = Field(description="Temperature and viscosity of the buffer.")
    field: FieldAxis = Field(description="Direction of the magnetic field.")
    model: Model = Field(
        default=Model(), description="What the simulation has beyond the baseline."
    )
    magnet: tuple[Magnet, ...] = Field(
        default=(),
        description="Forces known beforehand: a table [[magnet]] for each magnet position.",
    )
    magnets: Magnets | None = Field(
        default=None,
        description="The pair of magnets and the bead's magnetisation: forces that follow from "
        "them are compared with the magnet's curve (docs/magnet-curve.md).",
    )
    plateaus: Plateaus = Field(
        default=Plateaus(), description="What counts as a plateau of constant force."
    )
    drift: DriftChoice = Field(default=DriftChoice(), description="How drift is removed.")
    source: Source | None = Field(
        default=None,
        description="How files are laid out that are not canonical (docs/source-table.md).",
    )
    tracking: Tracking = Field(
        default=Tracking(),
        description="How beads are found and tracked in images (docs/tracking.md).",
    )
    report: ReportChoice = Field(
        default=ReportChoice(), description="What matters to whoever reads the report."
    )

    def __repr__(self) -> str:
        camera, tether = self.camera, self.tether
        return (
            f"Setup: {camera.frame_rate_hz} Hz, exposure {camera.exposure_s} s; bead radius "
            f"{self.beads.radius_nm} nm; contour length {tether.contour_length_nm} nm, persistence "
            f"length {tether.persistence_length_nm} nm; {self.buffer.temperature_K} K, "
            f"{self.buffer.viscosity_mPa_s} mPa s; effects: {', '.join(self.model.effects)}"
        )

    @property
    def table(self) -> pd.DataFrame:
        """A row for each key that the setup states or leaves at its default: key, value."""
        import pandas as pd

        return pd.DataFrame(
            [
                {"key": f"{name}.{key}" if key else name, "value": value}
                for name in type(self).model_fields
                for key, value in _stated(getattr(self, name))
            ]
        )

    def _repr_html_(self) -> str:
        return html_of(self)

    @model_validator(mode="after")
    def _one_force_per_position(self) -> Setup:
        forces: dict[float, float | None] = {}
        for one in self.magnet:
            position, force = one.position_mm.value, one.force_pN.value
            if position is None:
                continue
            if forces.setdefault(position, force) != force:
                raise ValueError(
                    f"[[magnet]] gives the position {position:g} mm two forces, "
                    f"{_shown(forces[position])} and {_shown(force)} pN; leave one of them"
                )
        return self


def _stated(table: Any) -> list[tuple[str, Any]]:
    if isinstance(table, BaseModel):
        return [(key, getattr(table, key)) for key in type(table).model_fields]
    return [] if table in (None, ()) else [("", table)]


def _shown(value: float | None) -> str:
    return f'"{UNKNOWN}"' if value is None else f"{value:g}"


def read_setup(path: Path | str) -> Setup:
    """Read and validate a `setup.toml`.

    Raises
    ------
    NoSetupError : the file is missing.
    SetupError : the file is no TOML, or a key is missing, misspelt or impossible.
    """
    try:
        # Windows' editors put a byte-order mark first
        content = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise NoSetupError(
            "there is no such setup file", where=str(path), mend=f"{PROPOSED}."
        ) from None
    except IsADirectoryError:
        raise NoSetupError("is a folder, not a setup file", where=str(path)) from None
    except (OSError, UnicodeDecodeError) as error:
        raise SetupError(f"cannot be read ({error})", where=str(path)) from None
    except RecursionError:
        raise SetupError("is not valid TOML: it is nested too deeply", where=str(path)) from None
    except ValueError as error:  # of TOML, and of Python where a number has too many digits
        raise SetupError(f"is not valid TOML: {error}", where=str(path)) from None
    return parse_setup(content, where=str(path))


def parse_setup(content: dict[str, Any], *, where: str = "setup") -> Setup:
    """Validate the content of a setup file.

    Raises
    ------
    SetupError : naming every key that is wrong.
    """
    try:
        return Setup.model_validate(content)
    except ValidationError as error:
        raise SetupError(_sentence(error), where=where) from None


def _sentence(error: ValidationError) -> str:
    parts = []
    for one in error.errors():
        key = ".".join(str(p) for p in one["loc"])
        text = _in_words(one["type"], one["loc"], one["msg"], one["input"])
        parts.append(f"[{key}] {text}" if key else text)
    return "; ".join(parts)


def _in_words(kind: str, place: tuple[int | str, ...], message: str, given: Any) -> str:
    """What pydantic says of one key, for people who write a setup and no Python."""
    if kind == "missing":
        if place == ("schema",):
            return "is missing (write schema = 1 before all tables)"
        if _can_be_measured(str(place[-1])):
            return f'is missing (write "{UNKNOWN}" for a value that is not known)'
        return "is missing"
    if kind == "extra_forbidden":
        return "is not a key of the setup"
    if kind == "value_error":
        return message.removeprefix("Value error, ")
    shown = repr(given)
    shown = f"{shown[:60]}..." if len(shown) > 60 else shown
    if place == ("magnet",) and isinstance(given, dict):
        return "is a list of tables: write [[magnet]] in place of [magnet]"
    if kind == "tuple_type":
        return f"must be a list, as in [{shown}]"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"must be a table with keys of its own, got {shown}"
    must_be = message.replace("Input should be", "must be").partition(", unable")[0]
    return f"{must_be}, got {shown}"


def _can_be_measured(name: str) -> bool:
    """Whether a key of this name, as exposure_s, may have the value "unknown"."""
    fields = [table.model_fields.get(name) for table in Section.__subclasses__()]
    return any(field is not None and is_measured(field.annotation) for field in fields)
