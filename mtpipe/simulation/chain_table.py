"""The tether's tension as a table.

The chain is the potential A(r) with dA/dr = its force-extension curve (`mtpipe.physics.tether`),
tabulated on a uniform grid of r that ends where the Boltzmann weight is e^-40 of its maximum: an
inextensible chain gets no nearer to its contour length than that. Beyond the end, which a discrete
step can reach, the chain pulls like the spring tension/r of the last node, so nothing diverges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.physics import tether
from mtpipe.physics.buffer import thermal_energy_pN_nm

_NODES = 1 << 16
_NEGLIGIBLE = 40.0


@dataclass(frozen=True, eq=False)
class ChainTable:
    """Tension of a chain on a uniform grid of the distance r between its ends.

    Attributes
    ----------
    distance_nm, energy_pN_nm : (nodes,) r from 0, and A.
    secant_pN_per_nm : (nodes,) tension/r, its limit at r = 0.
    """

    distance_nm: FloatArray
    energy_pN_nm: FloatArray
    secant_pN_per_nm: FloatArray


def tabulate(chain: tether.Chain, largest_force_pN: float) -> ChainTable:
    """The chain as far as it is ever stretched in equilibrium under forces up to the largest."""
    reach = reach_nm(chain, largest_force_pN, _NEGLIGIBLE)
    distance = np.linspace(0.0, reach, _NODES)
    tension = tether.force_pN(chain, distance)
    spacing = distance[1]
    energy = np.concatenate([[0.0], np.cumsum((tension[1:] + tension[:-1]) / 2 * spacing)])
    secant = tension.copy()
    secant[1:] /= distance[1:]
    secant[0] = tether.stiffness_pN_per_nm(chain, 0.0)
    return ChainTable(distance, energy, secant)


def reach_nm(chain: tether.Chain, force_pN: float, energy_kT: float) -> float:
    """The length beyond the rest length where A(r) - F r has risen by an energy in kT."""
    unit = chain.thermal_force_pN
    tension = force_pN + unit * np.geomspace(1e-4, 1e6, 4000)
    length = tether.extension_nm(chain, np.concatenate([[force_pN], tension]))
    work = np.cumsum((tension - force_pN) * np.diff(length))
    kT = float(thermal_energy_pN_nm(chain.temperature_K))
    return float(np.interp(energy_kT * kT, work, length[1:]))
