"""The setup: what a laboratory states about an experiment (`setup.toml`, FORMATS section 2).

Plain frozen data, validated on reading, every fault named by its key. A measurable value is a
`Measured`: with a standard error where the file gives `<name>_stderr`, and without a value where
the file says "unknown". Nothing has a default that a user can measure.
"""

from __future__ import annotations

import difflib
import math
import tomllib
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from mtpipe.ground.errors import NoSetupError, SetupError
from mtpipe.setup.source_table import Source
from mtpipe.setup.tracking_table import Tracking
from mtpipe.setup.usual_errors import usual_stderr

UNKNOWN = "unknown"
PROPOSED = "`mtpipe init` looks at a recording and proposes one"
# An effect is one file, called as it is; the files beside them are these.
PACKAGE, ROOMS = Path(__file__).parents[1], ("effects", "corrections")
NO_EFFECTS = ("__init__", "catalogue", "effect", "setup_sizes", "correction", "retraced")
EFFECTS = tuple(
    path.stem
    for room in ROOMS
    for path in sorted((PACKAGE / room).glob("*.py"))
    if path.stem not in NO_EFFECTS
)
# The slowest time lapse and the fastest detector with which anybody has followed a tethered bead.
FRAME_RATES_HZ = (0.1, 1e6)
# Entry points of other packages that bring effects.
EFFECTS_GROUP = "mtpipe.effects"


class Measured(BaseModel):
    """A measured value: `value` None means the laboratory does not know it.

    `usual` : the setup states no error, and `stderr` is what laboratories usually have.
    """

    model_config = ConfigDict(frozen=True)
    value: float | None
    stderr: float = Field(default=0.0, ge=0)
    usual: bool = False

    @property
    def known(self) -> bool:
        """Whether the laboratory states a value."""
        return self.value is not None

    @property
    def relative_stderr(self) -> float:
        """Standard error over value; nan where the value is unknown."""
        return math.nan if self.value is None else self.stderr / abs(self.value)


def _positive(measured: Measured) -> Measured:
    if measured.value is not None and not (measured.value > 0 and math.isfinite(measured.value)):
        raise ValueError(f"must be a positive number, got {measured.value}")
    return measured


def _finite(measured: Measured) -> Measured:
    if measured.value is not None and not math.isfinite(measured.value):
        raise ValueError(f"must be a finite number, got {measured.value}")
    return measured


Positive = Annotated[Measured, AfterValidator(_positive)]
Finite = Annotated[Measured, AfterValidator(_finite)]


def _is_measured(annotation: Any) -> bool:
    """Whether a field holds a Measured, be it annotated or optional."""
    return annotation is Measured or any(_is_measured(part) for part in get_args(annotation))


class Section(BaseModel):
    """A table of the setup; joins `name` and `name_stderr` into one `Measured`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _join_standard_errors(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        joined = dict(data)
        for name, field in cls.model_fields.items():
            if not _is_measured(field.annotation) or name not in joined:
                continue
            value, stderr = joined.pop(name), joined.pop(f"{name}_stderr", None)
            if value is None or isinstance(value, (dict, Measured)):
                joined[name] = value
            elif value == UNKNOWN and stderr:
                raise ValueError(f'{name}_stderr: there is no standard error of "{UNKNOWN}"')
            elif value == UNKNOWN:
                joined[name] = {"value": None}
            elif isinstance(value, bool) or not isinstance(value, (int, float)):
                raise ValueError(f'{name}: a number or "{UNKNOWN}" is needed, got {value!r}')
            elif stderr is None:
                usual = usual_stderr(name, value)
                joined[name] = {"value": float(value), "stderr": usual, "usual": usual > 0}
            elif isinstance(stderr, bool) or not isinstance(stderr, (int, float)) or stderr < 0:
                raise ValueError(f"{name}_stderr: a number of at least 0 is needed, got {stderr!r}")
            else:
                joined[name] = {"value": float(value), "stderr": float(stderr)}
        return joined


def _within(name: str, measured: Measured, low: float, high: float, unit: str) -> None:
    """Refuse a value that only a wrong unit explains.

    Chains are between peptides (persistence length 0.4 nm) and actin (some 10 µm).
    """
    if measured.value is not None and not low <= measured.value <= high:
        raise ValueError(
            f"{name} = {measured.value:g} is not between {low:g} and {high:g} {unit}; is its unit "
            "right?"
        )


class Camera(Section):
    """Frame rate, shutter time of a frame and, for files in pixels, the size of a pixel."""

    frame_rate_hz: Positive
    exposure_s: Positive
    pixel_size_nm: Positive | None = None

    @model_validator(mode="after")
    def _is_a_camera(self) -> Camera:
        _within("frame_rate_hz", self.frame_rate_hz, *FRAME_RATES_HZ, "Hz")
        return self

    @model_validator(mode="after")
    def _exposure_fits_in_a_frame(self) -> Camera:
        rate, exposure = self.frame_rate_hz.value, self.exposure_s.value
        if rate is not None and exposure is not None and exposure * rate > 1.001:
            raise ValueError(
                f"exposure_s = {exposure:g} s is longer than a frame (1/{rate:g} Hz = "
                f"{1 / rate:.6g} s); the shutter time of one frame is needed"
            )
        return self


class Beads(Section):
    """Bead radius and the names of the beads fixed to the surface."""

    radius_nm: Positive
    reference: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _radius_is_in_nm(self) -> Beads:
        _within("radius_nm", self.radius_nm, 50, 50_000, "nm")
        return self


class Tether(Section):
    """Contour and persistence length of the tether."""

    contour_length_nm: Positive
    persistence_length_nm: Positive

    @model_validator(mode="after")
    def _lengths_are_in_nm(self) -> Tether:
        _within("contour_length_nm", self.contour_length_nm, 20, 500_000, "nm")
        _within("persistence_length_nm", self.persistence_length_nm, 0.2, 100_000, "nm")
        return self


class Buffer(Section):
    """Temperature and viscosity of the buffer."""

    temperature_K: Positive
    viscosity_mPa_s: Positive

    @model_validator(mode="after")
    def _is_kelvin(self) -> Buffer:
        temperature = self.temperature_K.value
        if temperature is not None and not 250 < temperature < 400:
            raise ValueError(f"temperature_K = {temperature:g} is no temperature of a buffer in K")
        _within("viscosity_mPa_s", self.viscosity_mPa_s, 0.1, 1000, "mPa s")
        return self


class FieldAxis(Section):
    """Axis of the camera along the magnetic field lines."""

    direction: Literal["x", "y"]


def _nearest(name: str) -> str:
    near = difflib.get_close_matches(name, (*_effects(), "effects"), n=1)
    return f"; did you mean {near[0]}?" if near else f"; known: {', '.join(_effects())}"


def _effects() -> tuple[str, ...]:
    """Names of effects, those of other packages included."""
    return (*EFFECTS, *(entry.name for entry in entry_points(group=EFFECTS_GROUP)))


class Model(BaseModel):
    """Effects that the simulation includes beyond the baseline; their pinned parameters."""

    model_config = ConfigDict(frozen=True, extra="allow")
    effects: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _effects_exist(self) -> Model:
        for effect in self.effects:
            if effect not in _effects():
                raise ValueError(f"effects: there is no effect {effect!r}{_nearest(effect)}")
        for key, table in (self.model_extra or {}).items():
            if key not in _effects() or not isinstance(table, dict):
                raise ValueError(
                    f"{key}: only effects and a table [model.<effect>] can stand here"
                    f"{_nearest(key)}"
                )
        return self


class Magnet(Section):
    """A force known beforehand at a magnet position."""

    position_mm: Finite
    force_pN: Positive


class Plateaus(BaseModel):
    """What counts as a plateau.

    A stretch of resting magnets shorter than `minimum_s` is a magnet move. Magnet positions that
    differ by at most `tolerance_mm` are one value (0: exactly one value, as canonical recordings
    have it); `settle_s` is left out after each move.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    minimum_s: float = Field(default=5.0, gt=0)
    tolerance_mm: float = Field(default=0.0, ge=0)
    settle_s: float = Field(default=0.0, ge=0)


class DriftChoice(BaseModel):
    """How drift is removed (`[drift]`); the default is what the data ask for.

    `method`: "reference" subtracts the reference beads, low-passed at `cutoff_hz` ("auto": the
    frequency that minimises the noise added; "none": frame by frame). "highpass" removes all
    motion slower than `cutoff_hz`. "none" leaves the traces as they are.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    method: Literal["reference", "highpass", "none"] = "reference"
    cutoff_hz: float | Literal["auto", "none"] = "auto"

    @model_validator(mode="after")
    def _highpass_has_a_cutoff(self) -> DriftChoice:
        if isinstance(self.cutoff_hz, float) and not self.cutoff_hz > 0:
            raise ValueError(f"cutoff_hz must be positive, got {self.cutoff_hz}")
        if self.method == "highpass" and not isinstance(self.cutoff_hz, float):
            raise ValueError('method = "highpass" needs cutoff_hz = <number in Hz>')
        return self


class ReportChoice(BaseModel):
    """What matters to whoever reads the report (`[report]`).

    A mismatch that moves no force by more than the share `tolerance` leaves a bead good.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    tolerance: float = Field(default=0.03, gt=0, lt=1)


class Setup(BaseModel):
    """A whole setup."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)
    version: Literal[1] = Field(alias="schema")
    camera: Camera
    beads: Beads
    tether: Tether
    buffer: Buffer
    field: FieldAxis
    model: Model = Model()
    magnet: tuple[Magnet, ...] = ()
    plateaus: Plateaus = Plateaus()
    drift: DriftChoice = DriftChoice()
    source: Source | None = None
    tracking: Tracking = Tracking()
    report: ReportChoice = ReportChoice()

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
    return any(field is not None and _is_measured(field.annotation) for field in fields)
