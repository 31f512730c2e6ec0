"""Linear overdamped motion: coupled coordinates as a sum of independent relaxation modes.

Γ dX = −K X dt + √(2 kT Γ) dB with K symmetric and Γ symmetric positive; what is recorded are
linear combinations of X. With M = Γ^−½ K Γ^−½ = U diag(λ) Uᵀ every readout is a sum of independent
Ornstein–Uhlenbeck modes with relaxation times 1/λ (PHYSICS section 2; e.g. Risken 1989, section
6.5). Spectra and simulations both start from these modes.

Quadratic forms of the coordinates, such as the shortening of a tether that swings, are sums over
pairs of modes: the product of two modes relaxes at the sum of their rates (Isserlis 1918).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray


@dataclass(frozen=True, eq=False)
class LinearMotion:
    """Stiffness K (d, d), friction Γ (d, d) and readout (m, d): recorded = readout · X.

    Many at once have a first dimension more in K and Γ.
    """

    stiffness: FloatArray
    friction: FloatArray
    readout: FloatArray

    def of(self, i: int) -> LinearMotion:
        """One of many."""
        return LinearMotion(self.stiffness[i], self.friction[i], self.readout)


@dataclass(frozen=True, eq=False)
class NormalModes:
    """Independent modes of a linear motion in thermal equilibrium; of many with a first dimension
    more.

    Attributes
    ----------
    tau_s : (d,) relaxation times, slowest first.
    amplitude_nm : (m, d) what one standard deviation of each mode moves each readout.
    shape : (d, d) what it moves each coordinate.
    """

    tau_s: FloatArray
    amplitude_nm: FloatArray
    shape: FloatArray

    def of(self, i: int) -> NormalModes:
        """One of many."""
        return NormalModes(self.tau_s[i], self.amplitude_nm[i], self.shape[i])

    def covariance_nm2(self) -> FloatArray:
        """(m, m) covariance of the readouts, kT · readout K⁻¹ readoutᵀ (equipartition)."""
        return np.asarray(self.amplitude_nm @ self.amplitude_nm.T)

    def quadratic(self, form: FloatArray) -> FloatArray:
        """(d, d) matrix q of ½ Xᵀ form X = ½ Σ q_ij u_i u_j in units of the modes u."""
        return np.asarray(self.shape.T @ form @ self.shape)


def normal_modes(motion: LinearMotion, thermal_energy_pN_nm: float) -> NormalModes:
    """Modes of a linear motion, or of many at once.

    Raises
    ------
    ValueError : stiffness or friction is not positive definite; nothing would hold the bead.
    """
    values, vectors = np.linalg.eigh(motion.friction)
    if not np.all(values > 0):
        raise ValueError("the friction matrix is not positive definite")
    root = (vectors * values[..., None, :] ** -0.5) @ np.swapaxes(vectors, -1, -2)
    rates, modes = np.linalg.eigh(root @ motion.stiffness @ root)
    if not np.all(rates > 0):
        raise ValueError("the stiffness matrix is not positive definite")
    shape = root @ modes * np.sqrt(thermal_energy_pN_nm / rates)[..., None, :]
    # an eigenvector's sign is the library's choice: fixed here, so that a seed means one motion
    at = np.argmax(np.abs(shape), axis=-2, keepdims=True)
    shape = shape * np.sign(np.take_along_axis(shape, at, axis=-2))
    return NormalModes(1 / rates, motion.readout @ shape, shape)


def pair_modes(form: FloatArray, modes: NormalModes) -> tuple[FloatArray, FloatArray]:
    """Relaxation times and variances (pairs,) of the parts of ½ Xᵀ form X.

    Each pair of modes is an exponential covariance with the sum of both rates, so the camera acts
    as on one mode; exact to second order in statistics. Pairs without a part are left out.
    """
    q = modes.quadratic(form)
    first, second = np.triu_indices(len(q))
    rate = 1 / modes.tau_s
    variance = np.where(first == second, 0.5, 1.0) * q[first, second] ** 2
    there = variance > 1e-12 * np.max(variance, initial=0.0)
    tau = 1 / (rate[first] + rate[second])
    return np.asarray(tau[there]), np.asarray(variance[there])
