"""All corrections, in the order in which they are looked for.

A stuck bead crowds places within the pixel, so sticking comes first.
"""

from __future__ import annotations

from collections.abc import Callable

from mtpipe.corrections import pixel_locking, surface_sticking
from mtpipe.corrections.correction import Correction
from mtpipe.crosschecking.check import BeadCheck

Find = Callable[[BeadCheck], Correction | None]
CORRECTIONS: tuple[Find, ...] = (
    surface_sticking.find,
    pixel_locking.find,
)
# What a user can do about each, by name.
REMEDIES: dict[str, str] = {
    module.NAME: module.REMEDY for module in (surface_sticking, pixel_locking)
}
