"""A freely jointed chain: straight segments that turn freely against one another.

A segment of length b under a force F points along it like a dipole along a field, with the weight
e^(F b cos/kT): its mean cosine is Langevin's function. A chain of any number of segments is their
sum, so the mean height of its end at a constant force is exact, for short chains too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mtpipe.ground.types import FloatArray
from mtpipe.physics.buffer import thermal_energy_pN_nm

# Below this argument the series of Langevin's function is exact to 1e-15, and coth cancels.
SMALL = 1e-2


def langevin(x: ArrayLike) -> FloatArray:
    """coth x − 1/x, the mean cosine of a dipole (Langevin 1905); any shape, odd."""
    x = np.asarray(x, dtype=np.float64)
    large = np.where(np.abs(x) < SMALL, 1.0, x)
    series = x / 3 - x**3 / 45 + 2 * x**5 / 945
    return np.asarray(np.where(np.abs(x) < SMALL, series, 1 / np.tanh(large) - 1 / large))


def jointed_extension_nm(
    force_pN: ArrayLike,
    *,
    contour_length_nm: float,
    kuhn_length_nm: float,
    temperature_K: float,
    stretch_modulus_pN: float = np.inf,
) -> FloatArray:
    """Mean extension of a freely jointed chain at a constant force.

    L0 (coth(F b/kT) − kT/(F b)) (1 + F/K): Smith, Cui and Bustamante 1996, Science 271:795, who
    measured single-stranded DNA. Segments that are springs (Fiasconaro and Falo 2019, Physica A
    532:121929) extend by more than 1 + F/K says, by at most 2 kT/(b K) of L0
    (0.7 % for ssDNA).

    Parameters
    ----------
    force_pN : any shape.
    kuhn_length_nm : length b of a segment.
    stretch_modulus_pN : K; infinite for rigid segments.
    """
    force = np.asarray(force_pN, dtype=np.float64)
    pull = force * kuhn_length_nm / float(thermal_energy_pN_nm(temperature_K))
    return np.asarray(contour_length_nm * langevin(pull) * (1 + force / stretch_modulus_pN))
