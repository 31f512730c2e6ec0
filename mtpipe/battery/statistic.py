"""A statistic and its place: axis, plateaus, band, time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Statistic:
    """A statistic and its place.

    Attributes
    ----------
    statistic : its name.
    axis : "x", "y", "z", two of them, or "" for all.
    plateaus : indices of the plateaus it is about; all where it is pooled.
    band_hz : frequencies, or None where it is no matter of frequency.
    time_s : stretch of time within the plateau, or None for all of it.
    pooled : several plateaus are taken together.
    """

    statistic: str
    axis: str
    plateaus: tuple[int, ...]
    band_hz: tuple[float, float] | None = None
    time_s: tuple[float, float] | None = None
    pooled: bool = False


Values = list[tuple[Statistic, float]]
