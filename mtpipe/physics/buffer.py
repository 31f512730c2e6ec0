"""The buffer: thermal energy and viscosity, and the one place where mPa·s become pN·s/nm².

The buffer is taken to be water at atmospheric pressure; salt, glycerol or crowders change the
viscosity and have to be stated by the laboratory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import constants

BOLTZMANN_PN_NM_PER_K = constants.k * 1e21
"""Boltzmann's constant, exact by the definition of the kelvin (SI 2019); 1 J = 1e21 pN nm."""

PN_S_PER_NM2_PER_MPA_S = 1e-9
"""1 mPa s = 1e-3 N s/m² = 1e-9 pN s/nm²."""

WATER_RANGE_K = (273.15, 373.15)


def thermal_energy_pN_nm(temperature_K: ArrayLike) -> NDArray[np.float64]:
    """Thermal energy kT in pN nm; 4.047 at 293.15 K. Same shape as the temperature (K)."""
    return BOLTZMANN_PN_NM_PER_K * np.asarray(temperature_K, dtype=np.float64)


def viscosity_pN_s_per_nm2(viscosity_mPa_s: ArrayLike) -> NDArray[np.float64]:
    """Viscosity in the units of forces and lengths used everywhere inside."""
    return PN_S_PER_NM2_PER_MPA_S * np.asarray(viscosity_mPa_s, dtype=np.float64)


def water_viscosity_mPa_s(temperature_K: ArrayLike) -> NDArray[np.float64]:
    """Viscosity of pure water, 0.02414 · 10^(247.8 / (T - 140)) mPa s.

    Vogel's equation with the constants of Al-Shemmeri 2012 (Engineering Fluid Mechanics). Against
    the correlation of Huber et al. 2009 (IAPWS R12-08): within 0.2 % from 288 to 310 K, 0.4 %
    from 285 to 320 K, 2 % from freezing to boiling.

    Raises
    ------
    ValueError : a temperature is outside `WATER_RANGE_K`, where water at 1 bar is not liquid.
    """
    temperature = np.asarray(temperature_K, dtype=np.float64)
    low, high = WATER_RANGE_K
    outside = ~((temperature >= low) & (temperature <= high))
    if np.any(outside):
        raise ValueError(
            f"temperature_K = {temperature[outside].flat[0]:g}: water is liquid from "
            f"{low:g} to {high:g} K"
        )
    return np.asarray(0.02414 * 10 ** (247.8 / (temperature - 140.0)))
