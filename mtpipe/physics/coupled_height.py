"""Height of a tethered bead, whose tether swings and is stretched at once: one motion.

A tether that swings shortens z, and a tilted one is pulled less, so its length follows the swinging
as fast as it can; the lateral stiffness in turn is that of the tether's length. Of the height, its
powers and the products of lateral modes, equilibrium is known in closed form, and so is how fast
correlations begin to fall, as friction acts on the bead's coordinates one by one. The relaxation of
the height is that within their span (`mtpipe.physics.relaxation`).
"""

from __future__ import annotations

import numpy as np

from mtpipe.physics.axial import AxialMotion
from mtpipe.physics.camera import FloatArray
from mtpipe.physics.linear import NormalModes
from mtpipe.physics.relaxation import modes_of_first

# Powers of the height; a fourth changes nothing.
POWERS = 3
# Products of modes with less than this share of the largest covariance are rounding error.
ROUNDING = 1e-9


def coupled_height_modes(
    height: AxialMotion, modes: NormalModes, with_height_nm: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Relaxation of the height.

    Parameters
    ----------
    height : the equilibrium of the height, swinging included, and the mobility at each.
    modes : of the lateral coordinates, and of others that do not matter here.
    with_height_nm : (d, d) equilibrium covariance of products of two coordinates with the height,
        the coordinates' units times nm.

    Returns
    -------
    Relaxation times (k,) in s, slowest first, and variances (k,) in nm².
    """
    weight = height.density / height.density.sum()
    deviation = height.height_nm - weight @ height.height_nm
    spread = np.sqrt(weight @ deviation**2)
    exponent = np.arange(1, POWERS + 1)[:, None]
    powers = (deviation / spread) ** exponent
    slopes = exponent * (deviation / spread) ** (exponent - 1) / spread
    powers -= (powers @ weight)[:, None]
    back = np.linalg.inv(modes.shape)
    with_height = back @ with_height_nm @ back.T / spread
    first, second = np.triu_indices(len(with_height))
    with_height = with_height[first, second]
    there = np.abs(with_height) > ROUNDING * np.max(np.abs(with_height), initial=0.0)
    first, second, with_height = first[there], second[there], with_height[there]
    variance = np.where(first == second, 2.0, 1.0)
    covariance = np.diag(np.append(np.zeros(POWERS), variance))
    rate = np.diag(
        np.append(np.zeros(POWERS), variance * (1 / modes.tau_s)[[first, second]].sum(0))
    )
    covariance[:POWERS, :POWERS] = (powers * weight) @ powers.T
    diffusivity = height.thermal_energy_pN_nm * height.mobility_nm_per_s_pN
    rate[:POWERS, :POWERS] = (slopes * (weight * diffusivity)) @ slopes.T
    # what of a power does not go with the height itself does not go with the products either
    covariance[:POWERS, POWERS:] = np.outer(covariance[:POWERS, 0], with_height)
    covariance[POWERS:, :POWERS] = covariance[:POWERS, POWERS:].T
    tau_s, share = modes_of_first(covariance, rate)
    return tau_s, spread**2 * share
