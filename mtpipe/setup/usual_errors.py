"""Errors that laboratories usually have of what they state, where a setup states none.

No bead's radius is known to all digits. Docs: formats.md, section 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# Relative; a temperature's is in K.
USUAL_RELATIVE = {
    "radius_nm": 0.03,
    "viscosity_mPa_s": 0.02,
    "contour_length_nm": 0.01,
    "persistence_length_nm": 0.05,
    "pixel_size_nm": 0.01,
    "exposure_s": 0.01,
    "frame_rate_hz": 1e-4,
}
USUAL_TEMPERATURE_K = 1.0


def usual_stderr(name: str, value: float) -> float:
    """The usual standard error of a value, by its key in the setup; 0 where none is known."""
    if name == "temperature_K":
        return USUAL_TEMPERATURE_K
    return USUAL_RELATIVE.get(name, 0.0) * abs(value)


def exact(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a setup with every value exact that states no error of its own.

    For simulations, whose values are what they say.
    """
    return {
        table: values | _exact(values) if isinstance(values, dict) else values
        for table, values in content.items()
    }


def _exact(values: Mapping[str, Any]) -> dict[str, float]:
    return {
        f"{key}_stderr": 0.0
        for key, value in values.items()
        if isinstance(value, (int, float)) and usual_stderr(key, value) > 0
        if f"{key}_stderr" not in values
    }
