"""What a statistic is: its place, its words, and the function that works it out.

Those that one function works out together are a `Group`, which stands behind its function and is
entered in `mtpipe.crosschecking.battery.catalogue`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from mtpipe.crosschecking.battery.observed import Fixed, Observed


@dataclass(frozen=True)
class Statistic:
    """A statistic and its place.

    Attributes
    ----------
    kind : its name, that of a `Kind`.
    axis : "x", "y", "z", two of them, or "" for all.
    plateaus : indices of the plateaus it is about; all where it is pooled.
    band_hz : frequencies, or None where it is no matter of frequency.
    time_s : stretch of time within the plateau, or None for all of it.
    pooled : several plateaus are taken together.
    """

    kind: str
    axis: str
    plateaus: tuple[int, ...]
    band_hz: tuple[float, float] | None = None
    time_s: tuple[float, float] | None = None
    pooled: bool = False


Values = list[tuple[Statistic, float]]


@dataclass(frozen=True)
class Kind:
    """What all statistics of a name have in common.

    Attributes
    ----------
    name : as crosscheck.parquet has it.
    line : of the report's map it belongs to; those of bands are named after their frequencies.
    words : what is compared.
    odd : "large" where only large values are odd, as of the largest step there is; "large pooled"
        where that is so of all plateaus together.
    relative : it is taken relative to what is fitted.
    """

    name: str
    line: str
    words: str
    odd: Literal["both", "large", "large pooled"] = "both"
    relative: bool = True

    def only_large(self, pooled: bool) -> bool:
        """Whether only large values are odd, of single plateaus or of all together."""
        return self.odd == "large" or (pooled and self.odd == "large pooled")


@dataclass(frozen=True)
class Group:
    """Statistics that are worked out together.

    Attributes
    ----------
    values : their values, of the plateaus of a recording or a simulation (one `Observed` for each)
        and what both have in common. It gives the same statistics in the same order for both.
    kinds : the names there may be among them.
    """

    values: Callable[[Sequence[Observed], Fixed], Values]
    kinds: tuple[Kind, ...]
