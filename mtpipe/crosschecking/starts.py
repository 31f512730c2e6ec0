"""Where the fit of the configured experiment begins with what the laboratory does not know.

A value that the setup calls "unknown" is free in the fit (`mtpipe.joint_fit.parameters`), within a
factor of 4.5 of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import BaseModel

from mtpipe.ground.types import FloatArray
from mtpipe.setup.measured import Measured
from mtpipe.setup.setup import Setup

# Between the two common sizes, 500 and 1400 nm.
RADIUS_NM = 840.0
PERSISTENCE_NM = 50.0
# The highest mean height is this share of a contour under some piconewtons.
STRETCHED = 0.93


def with_starts(setup: Setup, positions_nm: Sequence[FloatArray]) -> Setup:
    """The setup with a value for all that the description of an experiment needs.

    Parameters
    ----------
    positions_nm : per plateau (n, 3), z above the surface, NaN where lost.
    """
    highest = max(float(np.nanmean(position[:, 2])) for position in positions_nm)
    beads = _filled(setup.beads, radius_nm=RADIUS_NM)
    tether = _filled(
        setup.tether,
        contour_length_nm=max(highest, 1.0) / STRETCHED,
        persistence_length_nm=PERSISTENCE_NM,
    )
    return setup.model_copy(update={"beads": beads, "tether": tether})


def _filled(table: BaseModel, **starts: float) -> Any:
    unknown = {
        name: Measured(value=value)
        for name, value in starts.items()
        if not getattr(table, name).known
    }
    return table.model_copy(update=unknown)
