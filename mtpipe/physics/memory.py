"""Hydrodynamic memory: the fluid that a bead has set in motion goes on, and drags the bead along.

In unsteady Stokes flow the friction of a sphere's translation depends on frequency,
γ(s) = γ (1 + √(s τ)) with the time τ = R²ρ/η in which motion spreads over the radius (Basset 1888;
Tolić-Nørrelykke et al. 2006; PHYSICS E22). The masses of bead and displaced fluid, of order s τ,
are left out: they count at frequencies about η/(R²ρ) only.

Of a motion without memory that is a sum of decays, variance v_i and time t_i, the response over kT
is C(s) = Σ v_i/(1 + s t_i), and its friction over kT is 1/Σ(v_i/t_i), whatever it is coupled to.
More friction on that coordinate makes of it C/(1 + C s √(s τ)/Σ(v_i/t_i)), and its power is
(4/ω) Im of this at s = −iω. The covariance is no sum of decays any more, but nearly one of decays
with variances of either sign; so cameras, lost frames and the like act on it as on any motion.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from mtpipe.ground.types import FloatArray

WATER_KG_PER_M3 = 1000.0
# Rates of the added decays, over the rate of each mode with at least LEAST_SHARE of the variance.
RATES = np.concatenate([[0.03, 0.1, 0.25, 0.5, 0.7, 0.85, 1.2, 1.5], np.geomspace(2.2, 1e5, 10)])
LEAST_SHARE = 0.02
# Number and range of the frequencies of their fit: from 1e-3 of the slowest such mode to 1e4 times
# the fastest. Variance and power at frequency 0 are kept as without memory: their residuals get the
# weight EXACT.
POINTS, BELOW, ABOVE, EXACT = 120, 1e-3, 1e4, 1e4


def memory_time_s(radius_nm: float, viscosity_mPa_s: float) -> float:
    """Time in which motion of water spreads over a bead's radius, R²ρ/η."""
    return (radius_nm * 1e-9) ** 2 * WATER_KG_PER_M3 / (viscosity_mPa_s * 1e-3)


def power_with_memory(
    omega_per_s: FloatArray, tau_s: FloatArray, variance_nm2: FloatArray, memory_s: float
) -> FloatArray:
    """One-sided power, nm²/Hz, of a motion with memory.

    Parameters
    ----------
    omega_per_s : (n,) 2π frequency, above 0.
    tau_s, variance_nm2 : (m,) decays of the motion without memory. memory_s : τ.
    """
    s = -1j * omega_per_s
    response = (variance_nm2 / (1 + s[:, None] * tau_s)).sum(axis=1)
    added = s * np.sqrt(s * memory_s) / np.sum(variance_nm2 / tau_s)
    return np.asarray(4 / omega_per_s * (response / (1 + response * added)).imag)


def remembering(
    tau_s: FloatArray, variance_nm2: FloatArray, memory_s: float
) -> tuple[FloatArray, FloatArray]:
    """Decays whose sum is a motion with memory.

    Parameters
    ----------
    tau_s, variance_nm2 : (m,) decays of the motion without memory. memory_s : τ, to be well below
        the times of the decays that matter.

    Returns
    -------
    Times (k,) in s and variances (k,) in nm², of either sign, of decays that have the motion's
    power to some 5 % of √(τ/t) or better.
    """
    total = variance_nm2.sum()
    main = variance_nm2 > LEAST_SHARE * total
    rates = np.concatenate([1 / tau_s, np.outer(1 / tau_s[main], RATES).ravel()])
    low, high = BELOW / tau_s[main].max(), ABOVE / tau_s[main].min()
    omega = low * (high / low) ** (np.arange(POINTS) / (POINTS - 1))
    without = _power(omega, tau_s) @ variance_nm2
    target = power_with_memory(omega, tau_s, variance_nm2, memory_s) / without
    of_each = np.empty((POINTS + 2, len(rates)), order="F")
    of_each[:POINTS] = _power(omega, 1 / rates) / without[:, None]
    of_each[POINTS] = EXACT / total
    of_each[POINTS + 1] = EXACT / (rates * (variance_nm2 @ tau_s))
    size = np.sqrt(np.einsum("fi,fi->i", of_each, of_each))
    of_each /= size
    wanted = np.append(target, [EXACT, EXACT])
    found = linalg.lstsq(
        of_each, wanted, cond=1e-11, lapack_driver="gelsy", overwrite_a=True, check_finite=False
    )[0]
    return np.asarray(1 / rates), np.asarray(found / size)


def _power(omega_per_s: FloatArray, tau_s: FloatArray) -> FloatArray:
    """(n, m) one-sided power of decays of unit variance."""
    return np.asarray(4 * tau_s / (1 + (omega_per_s[:, None] * tau_s) ** 2))
