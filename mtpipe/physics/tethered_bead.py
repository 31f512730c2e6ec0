"""A tethered bead across and along the field: friction by its height, modes, lever.

What radius, viscosity and extension say about one axis of motion. The tether is attached at the
bead's lowest point, so the bead's centre stands at extension + radius. Arrays broadcast: many radii
are evaluated at once where the radius is fitted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mtpipe.ground.types import FloatArray
from mtpipe.physics.friction import (
    parallel_wall_factor,
    perpendicular_wall_factor,
    rotation_wall_factor,
    stokes_pN_s_per_nm,
)
from mtpipe.physics.modes import Modes, rotating_bead


def friction_pN_s_per_nm(
    extension_nm: ArrayLike,
    radius_nm: ArrayLike,
    viscosity_mPa_s: ArrayLike,
    *,
    wall: bool,
    upright: bool = False,
) -> FloatArray:
    """Friction of a bead's translation, pN s/nm.

    Parameters
    ----------
    wall : with the surface's correction (Faxén, Brenner; `mtpipe.physics.friction`).
    upright : motion away from the surface (z) instead of along it.

    Raises
    ------
    FitError : with the wall, an extension that is not positive.
    """
    bulk = stokes_pN_s_per_nm(radius_nm, viscosity_mPa_s)
    if not wall:
        return bulk
    factor = perpendicular_wall_factor if upright else parallel_wall_factor
    radius = np.asarray(radius_nm, dtype=float)
    return np.asarray(bulk * factor(np.asarray(extension_nm) + radius, radius))


def lever_nm(extension_nm: ArrayLike, radius_nm: ArrayLike, *, along: ArrayLike) -> FloatArray:
    """Force over lateral stiffness, nm: L along the field, L + R across.

    Along the field the bead keeps its orientation and tilts the tether alone; across, tether and
    radius swing as one pendulum (te Velthuis et al. 2010, Eqs 5 and 6). Shapes broadcast; along the
    field the radius may be nan.
    """
    length, radius = np.asarray(extension_nm, dtype=float), np.asarray(radius_nm, dtype=float)
    return np.where(along, length, length + radius)


def turning_modes(extension_nm: ArrayLike, radius_nm: ArrayLike, *, wall: bool) -> Modes:
    """Modes across the field of a bead that turns freely about the field's axis.

    Source: Daldrop et al. 2015, Eq 16 (`rotating_bead`); rotational over translational friction is
    4R²/3 in the bulk, corrected near the surface by Goldman, Cox & Brenner 1967 over Faxén.
    """
    radius = np.asarray(radius_nm, dtype=float)
    ratio = 4 / 3 * radius**2
    if wall:
        height = np.asarray(extension_nm) + radius
        ratio = ratio * rotation_wall_factor(height, radius) / parallel_wall_factor(height, radius)
    return rotating_bead(extension_nm, radius, ratio)
