"""Columns of an estimate in a table of results."""

from __future__ import annotations

from mtpipe.ground.estimate import Estimate


def four(quantity: str, unit: str, estimate: Estimate | None) -> dict[str, float]:
    """The four columns of an estimate; nan where there is none."""
    if estimate is None:
        estimate = Estimate.missing(unit, "")
    suffix = f"_{unit}" if unit else ""
    low, high = estimate.interval
    return {
        f"{quantity}{suffix}": estimate.value,
        f"{quantity}_stderr{suffix}": estimate.stderr,
        f"{quantity}_low{suffix}": low,
        f"{quantity}_high{suffix}": high,
    }


def two(quantity: str, unit: str, estimate: Estimate | None) -> dict[str, float]:
    """The value and the standard error of an estimate; nan where there is none."""
    columns = list(four(quantity, unit, estimate).items())
    return dict(columns[:2])
