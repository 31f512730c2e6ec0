"""What is known of a bead before its series is fitted, from the setup and the reference beads.

A radius that the setup does not know has no prior, but a start: what the best free fit's friction
makes of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from scipy import optimize

from mtpipe.calibration.free_fits import NOISE_FACTOR
from mtpipe.calibration.series_choice import FreeTrace
from mtpipe.fit.series_model import BeadPrior
from mtpipe.physics.friction import parallel_wall_factor, stokes_pN_s_per_nm
from mtpipe.setup.conditions import Conditions

# The surface raises a friction along it by less than this factor, the series of Faxén at contact.
LARGEST_WALL_FACTOR = 4.0


def bead_prior(
    conditions: Conditions,
    reference_noise_nm: tuple[float | None, float | None],
    free: Sequence[FreeTrace],
) -> BeadPrior:
    """Prior knowledge of a bead for `mtpipe.fit.series_model`.

    Parameters
    ----------
    reference_noise_nm : in x and y, tracking noise of the reference beads; None where none tell it.
    free : the bead's lateral traces, at least one.
    """
    x, y = (None if noise is None else (noise, NOISE_FACTOR) for noise in reference_noise_nm)
    return BeadPrior(
        radius_nm=conditions.radius_nm or (_radius_from_friction(free, conditions), math.inf),
        viscosity_mPa_s=conditions.viscosity_mPa_s[0],
        friction_ln_stderr=conditions.friction_stderr_apart_from_radius,
        noise_nm=(x, y),
        along=conditions.along,
        wall=conditions.wall,
        rotation=conditions.rotation,
    )


def _radius_from_friction(free: Sequence[FreeTrace], conditions: Conditions) -> float:
    """Radius in nm by the fit that knows the friction best."""
    best = min(free, key=lambda one: one.fit.covariance[1, 1])
    per_nm = float(stokes_pN_s_per_nm(1.0, conditions.viscosity_mPa_s[0]))
    in_bulk = math.exp(best.fit.theta[1]) / per_nm
    if not conditions.wall:
        return in_bulk
    length = best.trace.extension_nm

    def excess(radius: float) -> float:
        return radius * float(parallel_wall_factor(length + radius, radius)) - in_bulk

    return float(optimize.brentq(excess, in_bulk / LARGEST_WALL_FACTOR, in_bulk))
