"""Motion away from the surface: one coordinate in the chain's own potential, with its own friction.

z is far from harmonic: the chain stiffens as it is stretched, and near the surface friction changes
with height. As one coordinate z it still has an exact solution: the Smoluchowski equation on a grid
is a symmetric tridiagonal matrix, and its eigenvectors are relaxation modes (Risken 1989, section
5.4; van Kampen 2007, chapter XIII). Spectra follow from a few of them.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh_tridiagonal

from mtpipe.physics.camera import FloatArray

# The slowest modes carry nearly all of the variance.
MODES = 4


@dataclass(frozen=True, eq=False)
class AxialMotion:
    """Where the bead's height is found, and how it moves there.

    Attributes
    ----------
    height_nm : (n,) uniform grid. density : (n,) of the heights, per nm.
    mobility_nm_per_s_pN : (n,) inverse friction at each height.
    thermal_energy_pN_nm : kT.
    """

    height_nm: FloatArray
    density: FloatArray
    mobility_nm_per_s_pN: FloatArray
    thermal_energy_pN_nm: float

    @property
    def step_nm(self) -> float:
        """Distance of the grid's nodes."""
        return float(self.height_nm[1] - self.height_nm[0])

    @functools.cached_property
    def modes(self) -> tuple[FloatArray, FloatArray]:
        """Relaxation times (modes,) in s, slowest first, and the variance of each in nm²."""
        between = np.sqrt(self.mobility_nm_per_s_pN[1:] * self.mobility_nm_per_s_pN[:-1])
        rate = self.thermal_energy_pN_nm * between / self.step_nm**2
        uphill = np.sqrt(self.density[1:] / self.density[:-1])
        diagonal = np.zeros_like(self.density)
        diagonal[:-1] += rate * uphill
        diagonal[1:] += rate / uphill
        n = len(self.density)
        rates, vectors = eigh_tridiagonal(
            diagonal, -rate, select="i", select_range=(1, min(MODES, n - 1))
        )
        weight = np.sqrt(self.density * self.step_nm)
        mean = float(np.sum(weight**2 * self.height_nm))
        deviation = self.height_nm - mean
        variance = (vectors.T @ (weight * deviation)) ** 2
        # all faster modes as one: the variance left, and the speed at which correlation begins to
        # fall, which is the mean diffusivity
        left = float(np.sum(weight**2 * deviation**2)) - float(variance.sum())
        falls = self.thermal_energy_pN_nm * float(weight**2 @ self.mobility_nm_per_s_pN)
        falls -= float(variance @ rates)
        fastest = max(falls / left, float(rates[-1])) if left > 0 else float(rates[-1])
        return (
            np.append(1 / rates, 1 / fastest),
            np.append(variance, max(left, 0.0)),
        )
