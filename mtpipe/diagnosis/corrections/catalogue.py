"""All corrections, in the order in which they are looked for.

A stuck bead crowds places within the pixel, so sticking comes first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from mtpipe.crosschecking.check import BeadCheck
from mtpipe.diagnosis.corrections import pixel_locking, surface_sticking, z_response
from mtpipe.diagnosis.corrections.correction import Correction

Find = Callable[[BeadCheck], Correction | None]


class FindBeside(Protocol):
    """As `Find`, with the generator of simulations."""

    def __call__(self, check: BeadCheck, random: np.random.Generator) -> Correction | None:
        """What was found; None: nothing."""


CORRECTIONS: tuple[Find, ...] = (
    surface_sticking.find,
    pixel_locking.find,
)
# Looked for once all other effects are there, beside simulations of these, which they draw.
LATE_CORRECTIONS: tuple[FindBeside, ...] = (z_response.find,)
# What a user can do about each, by name.
REMEDIES: dict[str, str] = {
    module.NAME: module.REMEDY for module in (surface_sticking, pixel_locking)
}
