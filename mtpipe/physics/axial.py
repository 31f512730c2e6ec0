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

from mtpipe.ground.types import FloatArray

# The slowest modes carry nearly all of the variance.
MODES = 4


@dataclass(frozen=True, eq=False)
class AxialMotion:
    """Where the bead's height is found, and how it moves there; all of it of many beads with a
    first dimension more.

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

    def of(self, i: int) -> AxialMotion:
        """One of many."""
        return AxialMotion(
            self.height_nm[i],
            self.density[i],
            self.mobility_nm_per_s_pN[i],
            self.thermal_energy_pN_nm,
        )

    @property
    def step_nm(self) -> float:
        """Distance of the grid's nodes."""
        return float(self.height_nm[1] - self.height_nm[0])

    @functools.cached_property
    def mean_nm(self) -> float:
        """Mean height."""
        return float(np.sum(self.height_nm * self.density) * self.step_nm)

    @functools.cached_property
    def modes(self) -> tuple[FloatArray, FloatArray]:
        """Relaxation times (modes,) in s, slowest first, and the variance of each in nm²."""
        diagonal, beside = self._relaxation
        rates, vectors = eigh_tridiagonal(
            diagonal, beside, select="i", select_range=(1, min(MODES, len(diagonal) - 1))
        )
        weight, deviation = self._weight, self._deviation_nm
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

    def third_cumulant_nm3(self, exposure_s: float) -> float:
        """Third cumulant of the mean height over an exposure.

        Three times within the exposure, in order, are joined by two relaxations.
        """
        rates, vectors = eigh_tridiagonal(*self._relaxation)
        weight, deviation = self._weight, self._deviation_nm
        # an exposure of a hundredth of a relaxation time is none
        relaxations = np.maximum(rates[1:] * exposure_s, 0.01)
        reached = vectors[:, 1:].T @ (weight * deviation)
        turned = vectors[:, 1:].T @ (deviation[:, None] * vectors[:, 1:])
        one, other = np.meshgrid(relaxations, relaxations, indexing="ij")
        return float(6 * reached @ (turned * _two_relaxations(one, other)) @ reached)

    @property
    def _weight(self) -> FloatArray:
        """(n,) the eigenvector of equilibrium."""
        return np.asarray(np.sqrt(self.density * self.step_nm))

    @property
    def _deviation_nm(self) -> FloatArray:
        return np.asarray(self.height_nm - float(np.sum(self._weight**2 * self.height_nm)))

    @property
    def _relaxation(self) -> tuple[FloatArray, FloatArray]:
        """Diagonal (n,) and what is beside it (n - 1,) of the symmetric matrix of rates."""
        between = np.sqrt(self.mobility_nm_per_s_pN[1:] * self.mobility_nm_per_s_pN[:-1])
        rate = self.thermal_energy_pN_nm * between / self.step_nm**2
        uphill = np.sqrt(self.density[1:] / self.density[:-1])
        diagonal = np.zeros_like(self.density)
        diagonal[:-1] += rate * uphill
        diagonal[1:] += rate / uphill
        return diagonal, -rate


def _two_relaxations(a: FloatArray, b: FloatArray) -> FloatArray:
    """∫∫ (1 − s − t) e^(−a s − b t) over s, t ≥ 0 with s + t ≤ 1."""
    apart = np.where(np.abs(b - a) < 1e-4 * a, 1e-4 * a, b - a)
    b = a + apart
    late = np.exp(-a) / a**2 - np.exp(-b) / b**2
    return np.asarray(1 / (a * b) - (a + b) / (a * b) ** 2 + late / apart)
