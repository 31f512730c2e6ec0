"""Hydrodynamic memory: the fluid that a bead has set in motion goes on, and drags the bead along.

In unsteady Stokes flow the friction of a sphere depends on frequency, γ(s) = γ (1 + √(s τ)) with
the time τ = R²ρ/η in which motion spreads over the radius (Basset 1888; Tolić-Nørrelykke et al.
2006; PHYSICS E22). The masses of bead and displaced fluid, of order s τ, are left out: they count
at frequencies about η/(R²ρ) only. A motion that without memory relaxes in the time t then has the
power, over its variance,

    4 t Re G / |1 − iωt G|²  with  G = 1 + √(−iω τ).

Its covariance is no sum of decays, but nearly one of decays with weights of either sign; so
cameras, lost frames and the like act on it as on any other motion.
"""

from __future__ import annotations

import functools

import numpy as np

from mtpipe.physics.camera import FloatArray

WATER_KG_PER_M3 = 1000.0
# Rates of the decays, over that without memory; they are fitted up to frequencies ωt so high.
RATES = np.concatenate(
    [[0.03, 0.1, 0.25, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5], np.geomspace(2.2, 1e5, 10)]
)
FREQUENCIES = np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 400)])
# That variance and power at frequency 0 are those without memory counts like so many frequencies.
EXACT = 1e4


def memory_time_s(radius_nm: float, viscosity_mPa_s: float) -> float:
    """Time in which motion of water spreads over a bead's radius, R²ρ/η."""
    return (radius_nm * 1e-9) ** 2 * WATER_KG_PER_M3 / (viscosity_mPa_s * 1e-3)


def power_with_memory(frequency: FloatArray, ratio: float) -> FloatArray:
    """Power of a motion with memory over 4 × variance × relaxation time.

    Parameters
    ----------
    frequency : ωt, over the rate without memory. ratio : √(τ/t).
    """
    slowed = 1 + np.sqrt(-1j * frequency) * ratio
    return np.asarray(slowed.real / np.abs(1 - 1j * frequency * slowed) ** 2)


def decays(ratio: float) -> tuple[FloatArray, FloatArray]:
    """Decays whose sum is a motion with memory, in power to some 4 % of √(τ/t).

    Parameters
    ----------
    ratio : √(τ/t), of memory's time and the motion's own; to be well below 1.

    Returns
    -------
    Rates (m,) over that without memory, and the share (m,) of the variance that each has; shares of
    either sign, with the sum 1.
    """
    without = 1 / (1 + FREQUENCIES**2)
    target = power_with_memory(FREQUENCIES, ratio) / without
    return RATES, _solution() @ np.append(target, [EXACT, EXACT])


@functools.cache
def _solution() -> FloatArray:
    """(rates, frequencies + 2) least squares for relative power, variance and power at 0."""
    of_each = RATES / (RATES**2 + FREQUENCIES[:, None] ** 2) * (1 + FREQUENCIES[:, None] ** 2)
    kept = EXACT * np.vstack([np.ones_like(RATES), 1 / RATES])
    return np.asarray(np.linalg.pinv(np.vstack([of_each, kept]), rcond=1e-12))
