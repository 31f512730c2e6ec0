"""Friction of a sphere in a fluid, free or near a plane surface.

A wall factor multiplies the bulk friction. It depends on the height h of the bead's CENTRE over the
radius R only; for a tether attached at the bead's lowest point h = extension + R (using the
extension instead overstates the factor: 1.52 for 1.26 at R = 1400 nm, 1 pN, contour 2700 nm).
Low Reynolds number, frequencies far below nu/(pi R²) (0.16 MHz for R = 1400 nm), no slip. The
coupling of translation and rotation by the wall is neglected: below 0.7 % of 6 pi eta R² for
h/R > 2.

A factor is evaluated for every h > R; its docstring says how far off it is where. At h <= R the
bead would be in the surface: that is refused, since it means a wrong zero of z or a wrong radius.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.physics.buffer import viscosity_pN_s_per_nm2


def stokes_pN_s_per_nm(radius_nm: ArrayLike, viscosity_mPa_s: ArrayLike) -> FloatArray:
    """Friction 6 pi eta R of a translating sphere in the bulk, pN s/nm (Stokes 1851)."""
    radius = np.asarray(radius_nm, dtype=np.float64)
    return 6 * np.pi * viscosity_pN_s_per_nm2(viscosity_mPa_s) * radius


def rotational_stokes_pN_nm_s(radius_nm: ArrayLike, viscosity_mPa_s: ArrayLike) -> FloatArray:
    """Friction 8 pi eta R³ of a rotating sphere in the bulk, pN nm s per radian."""
    radius = np.asarray(radius_nm, dtype=np.float64)
    return 8 * np.pi * viscosity_pN_s_per_nm2(viscosity_mPa_s) * radius**3


def parallel_wall_factor(centre_height_nm: ArrayLike, radius_nm: ArrayLike) -> FloatArray:
    """Factor on the friction of motion along the surface (x and y).

    Faxén 1922, in the form of Schäffer et al. 2007: with u = R/h
    1 / (1 - 9u/16 + u³/8 - 45u⁴/256 - u⁵/16). High by 0.05 % at h/R = 2.65, 0.24 % at 2, 1.0 % at
    1.54, 2.6 % at 1.3 and 4.4 % at 1.13; then it stays finite where the true friction diverges
    logarithmically: 1 % high at 1.045, 20 % low at 1.005 (Goldman, Cox & Brenner 1967).

    Parameters
    ----------
    centre_height_nm, radius_nm : arrays that broadcast.

    Raises
    ------
    FitError : a centre is not above the height of one radius.
    """
    u = _radius_over_height(centre_height_nm, radius_nm)
    return 1 / (1 - 9 * u / 16 + u**3 / 8 - 45 * u**4 / 256 - u**5 / 16)


def perpendicular_wall_factor(centre_height_nm: ArrayLike, radius_nm: ArrayLike) -> FloatArray:
    """Factor on the friction of motion towards and away from the surface (z).

    Fit of Schäffer et al. 2007 to the exact series of Brenner 1961: with u = R/h
    1 / (1 - 9u/8 + u³/2 - 57u⁴/100 + u⁵/5 + 7u¹¹/200 - u¹²/25). Within 0.1 % of the series for
    h/R >= 1.1, within 0.35 % down to 1.01, and diverging at contact as it must.

    Parameters, raises: as `parallel_wall_factor`.
    """
    u = _radius_over_height(centre_height_nm, radius_nm)
    return 1 / (1 - 9 * u / 8 + u**3 / 2 - 0.57 * u**4 + u**5 / 5 + 7 * u**11 / 200 - u**12 / 25)


def rotation_wall_factor(centre_height_nm: ArrayLike, radius_nm: ArrayLike) -> FloatArray:
    """Factor on the rotational friction about an axis along the surface, such as the field's.

    Far field, 1 + 5u³/16 (Goldman, Cox & Brenner 1967). Low by 0.3 % at h/R = 2, 1.6 % at 1.5,
    4 % at 1.3 and about 15 % at 1.1.

    Parameters, raises: as `parallel_wall_factor`.
    """
    return 1 + 5 * _radius_over_height(centre_height_nm, radius_nm) ** 3 / 16


def _radius_over_height(centre_height_nm: ArrayLike, radius_nm: ArrayLike) -> FloatArray:
    height = np.asarray(centre_height_nm, dtype=np.float64)
    radius = np.asarray(radius_nm, dtype=np.float64)
    inside = ~(height > radius)
    if np.any(inside):
        height, radius = np.broadcast_arrays(height, radius)
        raise FitError(
            f"the bead's centre at {height[inside].flat[0]:.0f} nm lies within one radius "
            f"({radius[inside].flat[0]:.0f} nm) of the surface",
            mend="Check where z = 0 is and the bead's radius.",
        )
    return np.asarray(radius / height)
