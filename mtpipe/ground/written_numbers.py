"""Numbers as a person writes them: significant digits, value ± error, an interval.

A number that is missing is "—" and never NaN.
"""

from __future__ import annotations

import math
from typing import Any

EMPTY = "—"


def is_number(value: Any) -> bool:
    """Whether a cell of a table holds a finite number."""
    return isinstance(value, (int, float)) and math.isfinite(value)


def number(value: Any, digits: int = 3) -> str:
    """A number to significant digits, without trailing zeros; "—" where missing."""
    if not is_number(value):
        return EMPTY
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if exponent < -4 or exponent >= 7:
        mantissa = f"{value / 10.0**exponent:.{digits - 1}f}"
        times = "" if mantissa == "1" else f"{with_minus(mantissa)} × "
        return f"{times}10{_superscript(exponent)}"
    shown = f"{value:.{max(digits - 1 - exponent, 0)}f}"
    return with_minus(shown.rstrip("0").rstrip(".") if "." in shown else shown)


def rounded(value: float, digits: int) -> str:
    """A number rounded to significant digits also before the decimal point: 1500, not 1483."""
    return number(float(f"{value:.{digits - 1}e}"), digits)


def with_error(value: Any, stderr: Any, *, brief: bool = True) -> str:
    """Value ± standard error, the error to one or two digits, the value to the same decimals.

    Two digits where the error starts with 1, 2 or 3 (so that rounding changes it by less than
    15 %), else one; always two where not `brief`. Without an error: four significant digits.
    """
    if not is_number(value):
        return EMPTY
    if not is_number(stderr) or stderr <= 0:
        return number(value, 4)
    decimals = _decimals(stderr, brief)
    largest = max(abs(value), stderr)
    exponent = math.floor(math.log10(largest))
    if exponent < -4 or exponent >= 7:
        places = max(decimals + exponent, 0)
        scale = 10.0**exponent
        mantissa = f"({value / scale:.{places}f} ± {stderr / scale:.{places}f})"
        return with_minus(mantissa) + f" × 10{_superscript(exponent)}"
    return with_minus(f"{_round(value, decimals)} ± {_round(stderr, decimals)}")


def with_arms(value: Any, stderr: Any, low: Any, high: Any, *, brief: bool = True) -> str:
    """Value with its 68 % interval: ± where it is about even, else "+above −below"."""
    if not (is_number(value) and is_number(low) and is_number(high) and low <= value <= high):
        return with_error(value, stderr, brief=brief)
    above, below = high - value, value - low
    if min(above, below) >= 0.75 * max(above, below) or max(above, below) == 0:
        even = stderr if is_number(stderr) and stderr > 0 else (high - low) / 2
        return with_error(value, even, brief=brief)
    decimals = _decimals(max(min(above, below), 0.4 * max(above, below)), brief)
    rounded = [_round(number_, decimals) for number_ in (value, above, below)]
    return with_minus(rounded[0]) + f" +{rounded[1]} −{rounded[2]}"


def _decimals(error: float, brief: bool) -> int:
    exponent = math.floor(math.log10(error))
    return (0 if brief and error / 10.0**exponent >= 3.95 else 1) - exponent


def _round(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"


def with_minus(shown: str) -> str:
    """A number with a minus sign in place of a hyphen."""
    return shown.replace("-", "−")


def _superscript(exponent: int) -> str:
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
