"""Height of a tethered bead, whose tether swings and is stretched at once: one motion.

A tether that swings shortens z, and a tilted one is pulled less, so its length follows the swinging
as fast as it can; the lateral stiffness in turn is that of the tether's length. Of the height, its
powers and the products of lateral modes, equilibrium is known in closed form, and so is how fast
correlations begin to fall, as friction acts on the bead's coordinates one by one. The relaxation of
the height is that within their span (`mtpipe.physics.relaxation`).
"""

from __future__ import annotations

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.physics.axial import AxialMotion
from mtpipe.physics.linear import NormalModes
from mtpipe.physics.relaxation import modes_of_first

# Powers of the height; a fourth changes nothing.
POWERS = 3
# Products of modes with less than this share of the largest covariance are rounding error.
ROUNDING = 1e-9


def coupled_height_modes(
    height: AxialMotion, modes: NormalModes, with_height_nm: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Relaxation of the heights of n beads of one kind.

    Parameters
    ----------
    height : of each, the equilibrium of the height, swinging included, and the mobility there.
    modes : of each, of the lateral coordinates and of others that do not matter here.
    with_height_nm : (n, d, d) equilibrium covariance of products of two coordinates with the
        height, the coordinates' units times nm.

    Returns
    -------
    Relaxation times (n, k) in s, slowest first, and variances (n, k) in nm², of which some may be 0
    (`mtpipe.physics.relaxation.modes_of_first`).
    """
    weight = height.density / height.density.sum(axis=-1, keepdims=True)
    deviation = height.height_nm - np.sum(weight * height.height_nm, axis=-1, keepdims=True)
    spread = np.sqrt(np.sum(weight * deviation**2, axis=-1))[:, None, None]
    unit, weight = (deviation / spread[:, 0])[:, None], weight[:, None]
    powers = np.multiply.accumulate(np.repeat(unit, POWERS, axis=1), axis=1)
    exponent = np.arange(1, POWERS + 1)[:, None]
    slopes = exponent * np.concatenate([np.ones_like(unit), powers[:, :-1]], axis=1) / spread
    powers -= np.sum(powers * weight, axis=-1, keepdims=True)
    back = np.linalg.inv(modes.shape)
    with_height = back @ with_height_nm @ np.swapaxes(back, 1, 2) / spread
    first, second = np.triu_indices(with_height.shape[1])
    with_height = with_height[:, first, second]
    least = ROUNDING * np.max(np.abs(with_height), axis=1, initial=0.0)
    there = np.any(np.abs(with_height) > least[:, None], axis=0)
    first, second, with_height = first[there], second[there], with_height[:, there]
    variance = np.where(first == second, 2.0, 1.0)
    covariance = np.zeros((len(weight), *2 * [POWERS + len(variance)]))
    rate = np.zeros_like(covariance)
    products = np.arange(POWERS, POWERS + len(variance))
    covariance[:, products, products] = variance
    rate[:, products, products] = variance * (
        1 / modes.tau_s[:, first] + 1 / modes.tau_s[:, second]
    )
    covariance[:, :POWERS, :POWERS] = (powers * weight) @ np.swapaxes(powers, 1, 2)
    diffusivity = height.thermal_energy_pN_nm * height.mobility_nm_per_s_pN[:, None]
    rate[:, :POWERS, :POWERS] = (slopes * weight * diffusivity) @ np.swapaxes(slopes, 1, 2)
    # what of a power does not go with the height itself does not go with the products either
    mixed = covariance[:, :POWERS, :1] * with_height[:, None]
    covariance[:, :POWERS, POWERS:] = mixed
    covariance[:, POWERS:, :POWERS] = np.swapaxes(mixed, 1, 2)
    tau_s, share = modes_of_first(covariance, rate)
    return tau_s, spread[:, 0] ** 2 * share
