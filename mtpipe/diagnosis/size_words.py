"""Sizes in words."""

from __future__ import annotations

import math

from mtpipe.recording.recording import AXES

# Factors beyond this, or below one over it, are not told as numbers.
MOST_TOLD = 100


def compared(ln: float, stderr: float, above: str, below: str, much: str = "times as high") -> str:
    """A factor, by its ln, in words: in percent, or as it is where it is large."""
    if is_large(ln):
        return f"{factor(ln, stderr)} {much}"
    return f"{percent(ln, stderr)} {above if ln > 0 else below}"


def is_large(ln: float) -> bool:
    """Whether a factor is told as it is, and not in percent."""
    return abs(ln) > math.log(2)


def factor(ln: float, stderr: float) -> str:
    """A factor as it is."""
    if abs(ln) > math.log(MOST_TOLD):
        return f"more than {MOST_TOLD}" if ln > 0 else f"less than {1 / MOST_TOLD:g}"
    value, error = math.exp(ln), math.exp(ln) * stderr
    digits = max(0, -math.floor(math.log10(max(error, 1e-6))))
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def percent(ln: float, stderr: float) -> str:
    """How far a factor is from one, without its sign."""
    value, error = 100 * abs(math.exp(ln) - 1), 100 * math.exp(ln) * stderr
    digits = 0 if error >= 0.95 else 1
    return f"{value:.{digits}f} ± {error:.{digits}f} %"


def capital(text: str) -> str:
    """With its first letter as a capital, but for the name of an axis."""
    return text if text.split(" ")[0] in AXES else text[:1].upper() + text[1:]
