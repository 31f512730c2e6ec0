"""What the JSON files of a run hold, as far as the report reads them (docs/run-folder.md).

A file is checked once, as it is read: whatever passes can be drawn. Keys that are not named here
may stand beside.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

# Charts have numbers of single precision, and no quantity is larger in its unit.
LARGEST = 1e30
Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Number = Finite | None
Three = tuple[Number, Number, Number]
Axis = Literal["x", "y", "z"]
Plateau = Annotated[int, Field(ge=0)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
Verdict = Literal["consistent", "explained", "described", "unexplained"]
DIAGNOSES = get_args(Verdict)


class Content(BaseModel):
    """Part of a file; numbers are numbers and words are words."""

    model_config = ConfigDict(strict=True)


class InputFile(Content):
    """A file that was read."""

    name: str
    bytes: int
    sha256: str


class SubtractedDrift(Content):
    """What was taken off every trace, along x, y and z."""

    method: str
    cutoff_hz: Three | None
    drift_rms_nm: Three | None
    noise_added_nm: Three | None


class SaidNotice(Content):
    """A notice, as in `mtpipe.ground.notice`."""

    code: str
    severity: Literal["info", "caution", "warning"]
    message: str
    bead: str | None = None
    plateau: Plateau | None = None
    axis: str | None = None


class TakenConditions(Content):
    """The numbers that took effect."""

    temperature_K: Positive


class LeftOut(Content):
    """A stretch of time that a reader had left out before the run."""

    bead: str
    from_s: Finite
    to_s: Finite


class RunContent(Content):
    """`run.json`."""

    run: str
    version: str
    recording: str
    setup: dict[str, Any]
    conditions: TakenConditions
    inputs: list[InputFile]
    drift: SubtractedDrift | None
    notices: list[SaidNotice]
    seed: int
    started: str
    seconds: dict[str, Finite]
    marks: list[LeftOut] = []


class NamedEffect(Content):
    """An effect and what it did, in a sentence."""

    effect: str
    sentence: str


class Located(Content):
    """What differs, and where."""

    axis: str
    plateaus: list[Plateau]
    band_hz: tuple[Number, Number] | None
    statistic: str
    p_value: Finite


class Term(Content):
    """A form without a name, in a sentence."""

    sentence: str


class NamedForce(Content):
    """Force of a plateau with the effects named, and before."""

    plateau: Plateau
    magnet_mm: Number
    force_pN: Number
    stderr_pN: Number
    force_before_pN: Number
    stderr_before_pN: Number


class Diagnosis(Content):
    """What is said of a bead."""

    verdict: Verdict
    located: list[Located]
    terms: list[Term]
    effects: list[NamedEffect]
    forces: list[NamedForce]


class MismatchContent(Content):
    """`mismatch.json`."""

    run: str
    beads: dict[str, Diagnosis]


class Residuals(Content):
    """A row per band along each axis and a column per plateau, and the mean heights."""

    x: list[list[Number]]
    y: list[list[Number]]
    z: list[list[Number]]
    height: list[Number]


class Stages(Content):
    """Residuals as configured and with what is named."""

    before: Residuals
    after: Residuals


class Expected(Content):
    """An expected spectrum, and recorded power over it."""

    expected_nm2_per_hz: list[Positive]
    ratio: list[Positive]


class NamedSpectrum(Content):
    """The spectrum in which naming changes most."""

    axis: Axis
    plateau: Plateau
    frequency_hz: list[Positive]
    ordinates: list[Positive]
    before: Expected
    after: Expected

    @model_validator(mode="after")
    def _fits(self) -> NamedSpectrum:
        stages = (self.before, self.after)
        _same_length(self.frequency_hz, self.ordinates)
        _same_length(self.frequency_hz, *(one.ratio for one in stages))
        _same_length(self.frequency_hz, *(one.expected_nm2_per_hz for one in stages))
        return self


class BeforeAfter(Content):
    """What is drawn of a bead of which an effect is named."""

    plateaus: list[Plateau]
    bands_hz: list[Positive]
    residuals: Stages
    spectra: list[NamedSpectrum] = Field(min_length=1)

    @model_validator(mode="after")
    def _fits(self) -> BeforeAfter:
        for one in (self.residuals.before, self.residuals.after):
            for rows in (one.x, one.y, one.z):
                _same_length(self.bands_hz[1:], rows)
                _same_length(self.plateaus, *rows)
            _same_length(self.plateaus, one.height)
        return self


class BeforeAfterContent(Content):
    """`details/before_after.json`."""

    run: str
    beads: dict[str, BeforeAfter]


class Shape(Content):
    """A course of time or a distribution that is left."""

    kind: Literal["mean", "variance", "distribution"]
    axis: Axis
    plateau: Plateau
    at: list[Finite] = Field(min_length=1)
    value: list[Number]
    value_low: list[Number]
    value_high: list[Number]
    curve: list[Number]
    curve_low: list[Number]
    curve_high: list[Number]

    @model_validator(mode="after")
    def _fits(self) -> Shape:
        _same_length(self.at, self.value, self.value_low, self.value_high)
        _same_length(self.at, self.curve, self.curve_low, self.curve_high)
        return self


class CorrectionCurve(Content):
    """The factor on the power, with its band of one standard error."""

    frequency_hz: list[Positive] = Field(min_length=1)
    factor: list[Positive]
    factor_low: list[Positive]
    factor_high: list[Positive]

    @model_validator(mode="after")
    def _fits(self) -> CorrectionCurve:
        _same_length(self.frequency_hz, self.factor, self.factor_low, self.factor_high)
        return self


class Panel(Content):
    """What is drawn of an axis."""

    axis: Axis
    plateau: Plateau | None
    frequency_hz: list[Positive] = Field(min_length=1)
    ratio: list[Positive]
    ratio_stderr: list[Finite]
    correction: CorrectionCurve | None

    @model_validator(mode="after")
    def _fits(self) -> Panel:
        _same_length(self.frequency_hz, self.ratio, self.ratio_stderr)
        return self


class CorrectedForce(Content):
    """Force of a plateau as fitted, and with the correction free."""

    plateau: Plateau
    magnet_mm: Number
    force_pN: Finite
    corrected_pN: Number
    corrected_stderr_pN: Number
    low_pN: Finite
    high_pN: Finite


class CorrectedPlace(Content):
    """A band, of one plateau or of all, in which the power is to be corrected."""

    plateau: Plateau | None
    band_hz: tuple[Number, Number]
    factor: Positive
    factor_stderr: Positive


class CorrectedAxis(Content):
    """Where the power along an axis is to be corrected."""

    axis: Axis
    places: list[CorrectedPlace]


class Correction(Content):
    """What the spectrum needs."""

    axes: list[CorrectedAxis]
    panels: list[Panel]
    forces: list[CorrectedForce]


class Unexplained(Content):
    """What is left of a bead."""

    sentence: str
    shapes: list[Shape]
    correction: Correction | None


class UnexplainedContent(Content):
    """`details/unexplained.json`."""

    run: str
    beads: dict[str, Unexplained]


def _same_length(first: list[Any], *others: list[Any]) -> None:
    lengths = {len(first), *(len(other) for other in others)}
    if len(lengths) > 1:
        raise ValueError(f"lists that belong together have {sorted(lengths)} entries")
