"""Measured values of a setup: with a standard error where one is stated, or unknown."""

from __future__ import annotations

import math
from typing import Annotated, Any, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from mtpipe.ground.written_numbers import with_error
from mtpipe.setup.usual_errors import usual_stderr

UNKNOWN = "unknown"


class Measured(BaseModel):
    """A measured value: `value` None means the laboratory does not know it.

    `usual` : the setup states no error, and `stderr` is what laboratories usually have.
    """

    model_config = ConfigDict(frozen=True)
    value: float | None
    stderr: float = Field(default=0.0, ge=0)
    usual: bool = False

    def __repr__(self) -> str:
        return UNKNOWN if self.value is None else with_error(self.value, self.stderr, brief=False)

    __str__ = __repr__

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


def is_measured(annotation: Any) -> bool:
    """Whether a field holds a Measured, be it annotated or optional."""
    return annotation is Measured or any(is_measured(part) for part in get_args(annotation))


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
            if not is_measured(field.annotation) or name not in joined:
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


def within(name: str, measured: Measured, low: float, high: float, unit: str) -> None:
    """Refuse a value that only a wrong unit explains.

    Chains are between peptides (persistence length 0.4 nm) and actin (some 10 µm).
    """
    if measured.value is not None and not low <= measured.value <= high:
        raise ValueError(
            f"{name} = {measured.value:g} is not between {low:g} and {high:g} {unit}; is its unit "
            "right?"
        )
