"""The tables of a setup that describe the experiment, and what is to be done with it.

Every key says what it means where it stands (`description`): `mtpipe explain` and
docs/setup-reference.md are made of that.
"""

from __future__ import annotations

import difflib
from importlib.metadata import entry_points
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from mtpipe.setup.measured import Finite, Measured, Positive, Section, within

# An effect is one file, called as it is (a correction may have its name, for what is seen in time
# only); the files beside them are these.
PACKAGE, ROOMS = Path(__file__).parents[1], ("effects", "diagnosis/corrections")
NO_EFFECTS = (
    "__init__",
    "catalogue",
    "effect",
    "setup_sizes",
    "correction",
    "retraced",
    "height_curve",
    "softness",
)
EFFECTS = tuple(
    dict.fromkeys(
        path.stem
        for room in ROOMS
        for path in sorted((PACKAGE / room).glob("*.py"))
        if path.stem not in NO_EFFECTS
    )
)
# The slowest time lapse and the fastest detector with which anybody has followed a tethered bead.
FRAME_RATES_HZ = (0.1, 1e6)
# Entry points of other packages that bring effects.
EFFECTS_GROUP = "mtpipe.effects"
# Effects that are fields of the description from the start, where a setup lists them.
DESCRIBED = ("wall_drag", "rotation_coupling", "tracking_noise", "anharmonic_tether")
WALL_DRAG, ROTATION, NOISE, ANHARMONIC = DESCRIBED


class Camera(Section):
    """Frame rate, shutter time of a frame and, for files in pixels, the size of a pixel."""

    frame_rate_hz: Positive = Field(
        description='Frames per second. "unknown": taken from time stamps or from the file.',
        examples=[120.0],
    )
    exposure_s: Positive = Field(
        description="Shutter time of one frame, at most 1/frame_rate_hz. It decides how far "
        "the camera blurs the motion, and so the force.",
        examples=[0.0083333],
    )
    pixel_size_nm: Positive | None = Field(
        default=None,
        description="Size of a pixel in the plane of the beads: for image stacks and for "
        "files in pixels.",
        examples=[100.0],
    )

    @model_validator(mode="after")
    def _is_a_camera(self) -> Camera:
        within("frame_rate_hz", self.frame_rate_hz, *FRAME_RATES_HZ, "Hz")
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

    radius_nm: Positive = Field(description="Radius of the tethered beads.", examples=[1400.0])
    reference: tuple[str, ...] = Field(
        default=(),
        description="Names of the beads that are fixed to the surface. All others are tethered.",
        examples=[["ref1"]],
    )

    @model_validator(mode="after")
    def _radius_is_in_nm(self) -> Beads:
        within("radius_nm", self.radius_nm, 50, 50_000, "nm")
        return self


class Tether(Section):
    """Contour and persistence length of the tether."""

    contour_length_nm: Positive = Field(
        description="Contour length of the tether: 0.338 nm per base pair of DNA.",
        examples=[2700.0],
    )
    persistence_length_nm: Positive = Field(
        description="Persistence length of the tether: about 50 nm for DNA in 10 mM salt or more.",
        examples=[50.0],
    )

    @model_validator(mode="after")
    def _lengths_are_in_nm(self) -> Tether:
        within("contour_length_nm", self.contour_length_nm, 20, 500_000, "nm")
        within("persistence_length_nm", self.persistence_length_nm, 0.2, 100_000, "nm")
        return self


class Buffer(Section):
    """Temperature and viscosity of the buffer."""

    temperature_K: Positive = Field(
        description="Temperature of the buffer at the beads.", examples=[298.15]
    )
    viscosity_mPa_s: Positive = Field(
        description="Viscosity of the buffer: 0.89 for water at 25 °C.", examples=[0.89]
    )

    @model_validator(mode="after")
    def _is_kelvin(self) -> Buffer:
        temperature = self.temperature_K.value
        if temperature is not None and not 250 < temperature < 400:
            raise ValueError(f"temperature_K = {temperature:g} is no temperature of a buffer in K")
        within("viscosity_mPa_s", self.viscosity_mPa_s, 0.1, 1000, "mPa s")
        return self


class FieldAxis(Section):
    """Axis of the camera along the magnetic field lines."""

    direction: Literal["x", "y"] = Field(
        description="Axis of the camera along the magnetic field lines. The stiffness is F/L "
        "along the field and F/(L + R) across.",
        examples=["x"],
    )


def _nearest(name: str) -> str:
    near = difflib.get_close_matches(name, (*effect_names(), "effects"), n=1)
    return f"; did you mean {near[0]}?" if near else f"; known: {', '.join(effect_names())}"


def effect_names() -> tuple[str, ...]:
    """Names of effects, those of other packages included."""
    return (*EFFECTS, *(entry.name for entry in entry_points(group=EFFECTS_GROUP)))


class Model(BaseModel):
    """Effects that the simulation includes beyond the baseline; their pinned parameters."""

    model_config = ConfigDict(frozen=True, extra="allow")
    effects: tuple[str, ...] = Field(
        default=(),
        description="Names of the effects that the simulation has beyond the baseline "
        "(docs/effects.md). A table [model.<effect>] pins parameters of one.",
        examples=[[WALL_DRAG, NOISE]],
    )

    @property
    def wall(self) -> bool:
        """Whether the surface raises the friction."""
        return WALL_DRAG in self.effects

    @property
    def turns(self) -> bool:
        """Whether the bead's rotation couples to its motion."""
        return ROTATION in self.effects

    @property
    def noisy(self) -> bool:
        """Whether tracked positions have white noise."""
        return NOISE in self.effects

    @property
    def anharmonic(self) -> bool:
        """Whether a bead at low force is followed through the whole of the tether's potential."""
        return ANHARMONIC in self.effects

    @model_validator(mode="after")
    def _effects_exist(self) -> Model:
        for effect in self.effects:
            if effect not in effect_names():
                raise ValueError(f"effects: there is no effect {effect!r}{_nearest(effect)}")
        for key, table in (self.model_extra or {}).items():
            if key not in effect_names() or not isinstance(table, dict):
                raise ValueError(
                    f"{key}: only effects and a table [model.<effect>] can stand here"
                    f"{_nearest(key)}"
                )
        return self


class Magnet(Section):
    """A force known beforehand at a magnet position."""

    position_mm: Finite = Field(
        description="Magnet position at which the force is known beforehand.", examples=[3.0]
    )
    force_pN: Positive = Field(description="The force there.", examples=[4.1])


class Magnets(Section):
    """The pair of magnets and the bead's magnetisation, from which forces are predicted."""

    width_mm: Positive = Field(
        description="Edge of one magnet in the direction from one to the other.", examples=[5.0]
    )
    length_mm: Positive = Field(description="Edge of one magnet along the gap.", examples=[5.0])
    height_mm: Positive = Field(description="Vertical edge of one magnet.", examples=[5.0])
    gap_mm: Positive = Field(description="Gap between the two magnets.", examples=[1.0])
    magnetised: Literal["vertical", "horizontal"] = Field(
        description="Direction of the magnetisation. The magnets of a vertical pair point against "
        "each other, those of a horizontal one the same way across the gap.",
        examples=["vertical"],
    )
    remanence_T: Positive = Field(description="Remanence of the magnets.", examples=[1.4])
    touching_mm: Finite = Field(
        description="Magnet position at which the magnets' lower faces would be as low as the "
        "beads. Their distance is that to this position.",
        examples=[0.0],
    )
    saturation_kA_per_m: Positive = Field(
        description="Magnetisation of a bead in a strong field, per volume of the bead.",
        examples=[42.0],
    )
    saturating_field_mT: Positive = Field(
        description="Field B0 of the bead's magnetisation, which is saturation times "
        "coth(B/B0) - B0/B.",
        examples=[12.0],
    )

    @model_validator(mode="after")
    def _is_a_pair_of_magnets(self) -> Magnets:
        for name in ("width_mm", "length_mm", "height_mm", "gap_mm"):
            within(name, getattr(self, name), 0.01, 1000, "mm")
        within("remanence_T", self.remanence_T, 0.01, 2.5, "T")
        within("saturation_kA_per_m", self.saturation_kA_per_m, 0.1, 2000, "kA/m")
        within("saturating_field_mT", self.saturating_field_mT, 0.1, 10_000, "mT")
        for name in type(self).model_fields:
            if isinstance(value := getattr(self, name), Measured) and not value.known:
                raise ValueError(f"{name}: forces are predicted from numbers; leave [magnets] out")
        return self


class Plateaus(BaseModel):
    """What counts as a plateau of constant force."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    minimum_s: float = Field(
        default=5.0,
        gt=0,
        description="Shortest plateau. A shorter stretch of resting magnets counts as a move.",
        examples=[5.0],
    )
    tolerance_mm: float = Field(
        default=0.0,
        ge=0,
        description="Magnet positions that differ by at most this are one value. 0: exactly "
        "one value, as canonical recordings have it.",
        examples=[0.01],
    )
    settle_s: float = Field(
        default=0.0, ge=0, description="Left out after each move of the magnets.", examples=[2.0]
    )


class DriftChoice(BaseModel):
    """How drift is removed."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    method: Literal["reference", "highpass", "none"] = Field(
        default="reference",
        description='"reference" subtracts the motion of the reference beads. "highpass" '
        'removes all motion slower than cutoff_hz. "none" leaves the traces as '
        "they are.",
        examples=["reference"],
    )
    cutoff_hz: float | Literal["auto", "none"] = Field(
        default="auto",
        description='Low-pass of the reference beads\' motion, or the high-pass. "auto": the '
        'frequency that adds the least noise. "none": frame by frame.',
        examples=[0.1],
    )

    @model_validator(mode="after")
    def _highpass_has_a_cutoff(self) -> DriftChoice:
        if isinstance(self.cutoff_hz, float) and not self.cutoff_hz > 0:
            raise ValueError(f"cutoff_hz must be positive, got {self.cutoff_hz}")
        if self.method == "highpass" and not isinstance(self.cutoff_hz, float):
            raise ValueError('method = "highpass" needs cutoff_hz = <number in Hz>')
        return self


class ReportChoice(BaseModel):
    """What matters to whoever reads the report."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    tolerance: float = Field(
        default=0.03,
        gt=0,
        lt=1,
        description="A mismatch that moves no force by more than this share leaves a bead "
        "good, with a note.",
        examples=[0.05],
    )
