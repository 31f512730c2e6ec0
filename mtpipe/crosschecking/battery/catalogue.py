"""The statistics of the battery, in the order in which they are worked out."""

from __future__ import annotations

from collections.abc import Mapping

from mtpipe.crosschecking.battery import agreement, shape, spectral, temporal
from mtpipe.crosschecking.battery.statistic import Group, Kind

GROUPS: tuple[Group, ...] = (
    spectral.BANDS_OF_POWER,
    spectral.NARROW_LINES,
    spectral.BETWEEN_AXES,
    spectral.WITH_REFERENCE,
    temporal.OVER_TIME,
    temporal.IRREVERSIBILITY,
    shape.MOMENTS,
    shape.ALLAN,
    shape.FRACTIONAL_PIXEL,
    shape.LOST_FRAMES,
    agreement.PER_TRACE,
    agreement.EXTENSIONS,
    agreement.KNOWN_FORCES,
)
KINDS: Mapping[str, Kind] = {kind.name: kind for group in GROUPS for kind in group.kinds}
