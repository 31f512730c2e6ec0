"""Friction of every coordinate of a bead, by its height."""

from __future__ import annotations

import numpy as np

from mtpipe.experiment.description import Experiment
from mtpipe.ground.types import FloatArray
from mtpipe.physics.friction import rotation_wall_factor, rotational_stokes_pN_nm_s
from mtpipe.physics.tethered_bead import friction_pN_s_per_nm

# Least height (nm) at which friction is computed: at contact the friction along z is infinite.
LEAST_HEIGHT_NM = 1.0


def frictions_at(experiment: Experiment, height_nm: FloatArray, coordinates: int) -> FloatArray:
    """(coordinates, …) friction at heights (…) of the bead's lowest point.

    Along the surface twice and away from it, pN s/nm; then of as many angles as there are, pN nm s.
    """
    fluid, radius = experiment.fluid, experiment.bead.radius_nm
    along, up = (
        friction_pN_s_per_nm(
            height_nm, radius, fluid.viscosity_mPa_s, wall=fluid.wall, upright=upright
        )
        for upright in (False, True)
    )
    turning = np.asarray(rotational_stokes_pN_nm_s(radius, fluid.viscosity_mPa_s))
    if fluid.wall:
        turning = turning * rotation_wall_factor(height_nm + radius, radius)
    each = [along, along, up] + [turning] * (coordinates - 3)
    return np.array([np.broadcast_to(friction, height_nm.shape) for friction in each])
