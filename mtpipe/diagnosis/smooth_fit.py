"""The marginal likelihood of smooth factors on spectra, and the factors that have most of it.

Factors are cubic B-splines of ln f whose coefficients are Gaussian about none, near ones alike (a
Matérn covariance of order 3/2; Rasmussen & Williams 2006, eq. 4.17). Without such a prior a few
splines would oscillate where the data are weak in order to follow a bend where they are strong.
Binned power is a gamma variate about its expectation (Whittle 1953), traces apart; what else is
fitted moves the expectation to first order of ln S.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, linalg

from mtpipe.diagnosis.smooth_curve import matern
from mtpipe.ground.types import FloatArray

# Distance of the splines in ln f.
SPACING, DEGREE = 0.5, 3
# Standard deviations of the coefficients that are tried, in ln of power, and the distances in ln f
# over which they are alike.
PRIORS = tuple((width, length) for width in (0.05, 0.15, 0.5, 1.5) for length in (0.7, 2.0))
MOST_ROUNDS, LONGEST_STEP, ARRIVED = 60, 1.0, 1e-4
# Relative ridge for degenerate parameters.
LEAST = 1e-9


@dataclass(frozen=True, eq=False)
class Spectra:
    """Recorded beside expected power, row by row of all traces, and what the expectation follows.

    Attributes
    ----------
    axis, plateau : (rows,) indices. frequency_hz, ordinates : (rows,) of each bin.
    ratio : (rows,) recorded power over expected.
    response : (rows, n) ∂ ln S/∂θ of what is fitted anyway; the first coordinates are ln force.
    pull : (m,) heights and priors, distances in standard errors. pull_response : (m, n) per θ.
    room : (2, n) how far θ may go down and up.
    """

    axis: NDArray[np.int64]
    plateau: NDArray[np.int64]
    frequency_hz: FloatArray
    ordinates: FloatArray
    ratio: FloatArray
    response: FloatArray
    pull: FloatArray
    pull_response: FloatArray
    room: FloatArray

    @property
    def plateaus(self) -> int:
        """Number of plateaus."""
        return int(self.plateau.max()) + 1


@dataclass(frozen=True, eq=False)
class Term:
    """Columns of an axis's correction (rows, curves · splines), and the coefficients' precision."""

    axis: int
    common: bool
    columns: FloatArray
    precision: FloatArray


@dataclass(frozen=True, eq=False)
class Solution:
    """θ's change and the coefficients z, their information, which of them are at no bound, and ln
    of the marginal likelihood.
    """

    terms: list[Term]
    z: FloatArray
    information: FloatArray
    moving: NDArray[np.bool_]
    ln_evidence: float

    @property
    def covariance(self) -> FloatArray:
        """Of z."""
        index = np.flatnonzero(self.moving)
        inner = self.information[np.ix_(index, index)]
        scale = 1 / np.sqrt(np.maximum(np.diag(inner), 1e-300))
        inverse = np.linalg.pinv(inner * np.outer(scale, scale), hermitian=True)
        covariance = np.zeros_like(self.information)
        covariance[np.ix_(index, index)] = inverse * np.outer(scale, scale)
        return covariance


def spline_basis(frequency_hz: FloatArray, band_hz: tuple[float, float]) -> FloatArray:
    """(n, splines) cubic B-splines of ln f, which sum up to 1 everywhere in the band."""
    low, high = np.log(band_hz)
    there = np.clip(np.log(frequency_hz), low, high)
    return np.asarray(interpolate.BSpline.design_matrix(there, _knots(band_hz), DEGREE).toarray())


def _knots(band_hz: tuple[float, float]) -> FloatArray:
    low, high = np.log(band_hz)
    inner = np.linspace(low, high, max(round((high - low) / SPACING), 1) + 1)
    return np.concatenate([[low] * DEGREE, inner, [high] * DEGREE])


def _precision(band_hz: tuple[float, float], width: float, length: float) -> FloatArray:
    """(splines, splines) inverse covariance of the coefficients, each at its spline's middle."""
    knots = _knots(band_hz)
    middles = np.array(
        [knots[k + 1 : k + 1 + DEGREE].mean() for k in range(len(knots) - DEGREE - 1)]
    )
    apart = np.abs(np.subtract.outer(middles, middles))
    return np.asarray(np.linalg.inv(matern(apart, width, length)))


def terms_of(
    spectra: Spectra, basis: FloatArray, band_hz: tuple[float, float], axis: int, common: bool
) -> list[Term]:
    """An axis's correction with every prior."""
    mine = spectra.axis == axis
    groups = [mine] if common else [mine & (spectra.plateau == i) for i in range(spectra.plateaus)]
    columns = np.hstack([basis * group[:, None] for group in groups])
    blocks = np.eye(len(groups))
    each = [np.asarray(np.kron(blocks, _precision(band_hz, *prior))) for prior in PRIORS]
    return [Term(axis, common, columns, one) for one in each]


def best_solution(spectra: Spectra, begun: Solution | None, last: list[Term]) -> Solution:
    """Solution with the terms that there are and the most likely of the last.

    Parameters
    ----------
    begun : with the terms that there are; None: none. last : one term with every prior; none: none.
    """
    taken = [] if begun is None else begun.terms
    terms = [*taken, *last[:1]]
    design = np.hstack([spectra.response, *(term.columns for term in terms)])
    missing = design.shape[1] - spectra.response.shape[1]
    pulls = np.pad(spectra.pull_response, ((0, 0), (0, missing)))
    # a gamma variate's Fisher information about ln of its mean is its number of ordinates
    information = design.T @ (spectra.ordinates[:, None] * design) + pulls.T @ pulls
    z = np.zeros(design.shape[1])
    if begun is not None:
        z[: len(begun.z)] = begun.z
    solutions = []
    for one in [[*taken, one] for one in last] or [[]]:
        # the optimum moves little from prior to prior, so each fit starts at the one before
        solutions.append(_solved(spectra, one, design, pulls, information, z))
        z = solutions[-1].z
    return max(solutions, key=lambda one: one.ln_evidence)


def _solved(
    spectra: Spectra,
    terms: list[Term],
    design: FloatArray,
    pulls: FloatArray,
    information: FloatArray,
    z: FloatArray,
) -> Solution:
    """Fisher scoring from z; θ at a bound that the step would leave is held there.

    Laplace's approximation of the marginal likelihood, up to what is the same whatever the terms.
    """
    n, free = spectra.ordinates, spectra.response.shape[1]
    precision = linalg.block_diag(np.zeros((free, free)), *(term.precision for term in terms))
    total = information + precision
    scale = 1 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    scaled = total * np.outer(scale, scale) + LEAST * np.eye(len(total))
    room = np.pad(spectra.room, ((0, 0), (0, len(total) - free)))
    room[:, free:] = [[-np.inf], [np.inf]]

    def value_of(z: FloatArray) -> float:
        ln = design @ z
        off = spectra.pull + pulls @ z
        with np.errstate(over="ignore"):
            spectral = float(n @ (ln + spectra.ratio * np.exp(-ln)))
        return -spectral - 0.5 * float(off @ off) - 0.5 * float(z @ precision @ z)

    value, moving, factor = value_of(z), np.zeros(len(z), dtype=bool), None
    for _ in range(MOST_ROUNDS):
        excess = n * (spectra.ratio * np.exp(-design @ z) - 1)
        gradient = design.T @ excess - pulls.T @ (spectra.pull + pulls @ z) - precision @ z
        held = ((z <= room[0]) & (gradient < 0)) | ((z >= room[1]) & (gradient > 0))
        if factor is None or np.any(moving == held):
            moving = ~held
            factor = linalg.cho_factor(scaled[np.ix_(moving, moving)])
        step = np.zeros(len(z))
        step[moving] = linalg.cho_solve(factor, (gradient * scale)[moving]) * scale[moving]
        if float(gradient @ step) < ARRIVED:
            break
        step *= min(1.0, LONGEST_STEP / max(float(np.max(np.abs(design @ step))), 1e-300))
        while (there := value_of(np.clip(z + step, *room))) < value and np.any(step):
            step = step / 2 if np.max(np.abs(step)) > 1e-12 else np.zeros(len(z))
        z, value = np.clip(z + step, *room), there
    determinant = float(np.linalg.slogdet(scaled)[1]) - 2 * float(np.sum(np.log(scale)))
    prior = sum(float(np.linalg.slogdet(term.precision)[1]) for term in terms)
    return Solution(terms, z, total, moving, value + 0.5 * prior - 0.5 * determinant)
