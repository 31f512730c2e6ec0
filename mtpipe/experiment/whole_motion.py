"""A bead at low force: its motion in the whole of the tether's potential, down to the surface.

At a force of few kT/Lp the bead wanders so far that expansions about its mean (`state`) no longer
hold: how stiff the tether is, which way it pulls and how much the surface slows the bead change on
the way, z and the lateral motion are one, and the surface is a wall (PHYSICS E20). Here the
equilibrium is sampled as it is, and the relaxation of x, y and z is that of polynomials of all
coordinates in it (`mtpipe.physics.relaxation`).

Coordinates: X and Y of the bead's centre along and across the field, the height z of its lowest
point, the angle φ about the field's axis, the tilt ψ of its axis if the field holds that with a
finite torque. The tether's end is at X − a cos φ sin ψ, Y − a sin φ and
z + R − a cos φ cos ψ with the lever a. In terms of the end the energy is a sum, A(r) − F z of the
chain's end and a part of the angles alone, so each is drawn by itself.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from mtpipe.experiment.description import Allowance, Experiment
from mtpipe.experiment.frictions import LEAST_HEIGHT_NM, frictions_at
from mtpipe.experiment.tethers import Tether
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.physics.relaxation import modes_of_first, relaxation_matrices

# Binary logarithm of the number of points that sample the equilibrium; degree of polynomials.
LN2_POINTS, DEGREE = 12, 3
# Width of the cut that the surface makes in the density, in standard deviations of z without it:
# not sharp, so that expectations change smoothly with the force. Least effective number of points
# left above the surface.
EDGE, FEWEST = 0.02, 100
# Size of the cache of sampled equilibria.
MOST_KNOWN = 512
X, Y, Z, PHI, PSI = range(5)
# For each axis, whether (1) or not (0) a function changes its sign with x, and with y.
PARITY = {X: (1, 0), Y: (0, 1), Z: (0, 0)}


@dataclass(frozen=True, eq=False)
class _OneAxis:
    """What sets the relaxation of one axis.

    Attributes
    ----------
    axis : X, Y or Z. size_nm : its spread. covariance : (m, m) of polynomials, the axis first.
    rates : (coordinates, m, m) how fast their correlations begin to fall by each coordinate.
    """

    axis: int
    size_nm: float
    covariance: FloatArray
    rates: FloatArray


def whole_motion(
    experiment: Experiment, force_pN: float, tether: Tether
) -> tuple[float, FloatArray, FloatArray]:
    """Mean height and relaxation of the motion of a bead that turns about the field's axis.

    Parameters
    ----------
    tether : the experiment's chain at the force, without a surface.

    Returns
    -------
    Mean height in nm; relaxation times (m,) in s and covariances (m, 3, 3) of the modes, which are
    of one axis of the camera each.

    Raises
    ------
    FitError : the tether holds the bead in the surface nearly always.
    """
    mean, axes = _sampled(replace(experiment, allowance=Allowance()), force_pN, tether)
    tau_s, covariance = [], []
    of_camera = {X: experiment.along, Y: 1 - experiment.along, Z: Z}
    for one in axes:
        allowed = np.ones(len(one.rates))
        allowed[Z] = 1 / experiment.allowance.upward_friction
        times, variance = modes_of_first(one.covariance, np.tensordot(allowed, one.rates, 1))
        of_axis = np.zeros((len(times), 3, 3))
        seen = of_camera[one.axis]
        of_axis[:, seen, seen] = variance * one.size_nm**2
        tau_s.append(times)
        covariance.append(of_axis)
    return mean, np.concatenate(tau_s), np.concatenate(covariance)


@functools.lru_cache(maxsize=MOST_KNOWN)
def _sampled(
    experiment: Experiment, force_pN: float, tether: Tether
) -> tuple[float, tuple[_OneAxis, ...]]:
    """Mean height, and each axis. Kept, as fits ask again with other allowances."""
    energy = experiment.fluid.thermal_energy_pN_nm
    place, weight = _equilibrium(experiment, force_pN, tether.distance_nm, tether.weight)
    height = place[Z]
    mean = float(weight @ height)
    # angles count by their sine
    angles = place[PHI:]
    values = np.vstack([place[X], place[Y], height - mean, np.sin(angles)])
    slopes = np.vstack([np.ones_like(place[:3]), np.cos(angles)])
    size = np.sqrt(values**2 @ weight)
    unit, slope = values / size[:, None], slopes / size[:, None]
    diffusivity = energy * _mobility(experiment, height, len(place))
    axes = []
    for axis, parity in PARITY.items():
        powers = _powers(len(place), axis, parity)
        functions, derivatives = _polynomials(unit, slope, powers)
        functions -= (functions @ weight)[:, None]
        matrices = relaxation_matrices(weight, functions, derivatives, diffusivity)
        axes.append(_OneAxis(axis, float(size[axis]), *matrices))
    return mean, tuple(axes)


@functools.cache
def _uniform(dimensions: int) -> FloatArray:
    """(dimensions, points) that fill a unit cube evenly; none on its faces."""
    points = qmc.Sobol(dimensions, scramble=False).random_base2(LN2_POINTS)
    return np.asarray(points.T + 0.5 / 2**LN2_POINTS)


def _equilibrium(
    experiment: Experiment, force_pN: float, distance_nm: FloatArray, share: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Coordinates (4 or 5, points) of the equilibrium, and the weight (points,) of each point."""
    energy, bead = experiment.fluid.thermal_energy_pN_nm, experiment.bead
    magnets, lever = experiment.magnets, bead.lever_nm
    tilts = magnets.alignment_pN_nm is not None
    even = _uniform(4 + tilts)
    distance = _inverse(distance_nm, share, even[0])
    # directions of the half space above the anchor, by e^(pull cos)
    pull = force_pN * distance / energy
    cosine = 1 + np.log1p(even[1] * np.expm1(-pull)) / pull
    across, azimuth = distance * np.sqrt(1 - cosine**2), 2 * np.pi * even[2]
    swing = force_pN * lever / energy
    phi = _angle(swing, even[3])
    psi, log_weight = np.zeros_like(distance), np.zeros_like(distance)
    if magnets.alignment_pN_nm is not None:
        psi = _angle(swing + magnets.alignment_pN_nm / energy, even[-1])
        # each angle was drawn as if the other were 0
        log_weight += swing * (1 - np.cos(phi)) * (1 - np.cos(psi))
    x = across * np.cos(azimuth) + lever * np.cos(phi) * np.sin(psi)
    y = across * np.sin(azimuth) + lever * np.sin(phi)
    z = distance * cosine - bead.radius_nm + lever * np.cos(phi) * np.cos(psi)
    log_weight -= magnets.sideways_at(force_pN) * (x**2 + y**2) / (2 * energy)
    weight = np.exp(log_weight - log_weight.max())
    weight *= np.clip(z / (EDGE * z.std()) + 0.5, 0, 1)
    if not weight.sum() ** 2 > FEWEST * np.sum(weight**2):
        raise FitError(f"at {force_pN:g} pN the tether does not hold the bead off the surface")
    return np.vstack([x, y, z, phi, *[psi] * tilts]), weight / weight.sum()


def _inverse(grid: FloatArray, share: FloatArray, uniform: FloatArray) -> FloatArray:
    """Quantiles of a density on a uniform grid, each node's share lying half a step to each
    side."""
    step = grid[1] - grid[0]
    edges = np.append(grid - step / 2, grid[-1] + step / 2)
    return np.asarray(np.interp(uniform, np.append(0.0, np.cumsum(share)), edges))


def _angle(swing: float, uniform: FloatArray) -> FloatArray:
    """Quantiles of an angle's density e^(swing cos)."""
    widest = min(np.pi, 9 / np.sqrt(swing))
    grid = np.linspace(-widest, widest, 2001)
    share = np.exp(swing * (np.cos(grid) - 1))
    return _inverse(grid, share / share.sum(), uniform)


def _mobility(experiment: Experiment, height_nm: FloatArray, coordinates: int) -> FloatArray:
    """(coordinates, points) inverse friction at each height."""
    return 1 / frictions_at(experiment, np.maximum(height_nm, LEAST_HEIGHT_NM), coordinates)


@functools.cache
def _powers(coordinates: int, axis: int, parity: tuple[int, int]) -> tuple[tuple[int, ...], ...]:
    """Exponents of the monomials that change their sign as an axis does, the axis itself first."""
    found = [
        powers
        for powers in itertools.product(range(DEGREE + 1), repeat=coordinates)
        if 0 < sum(powers) <= DEGREE and _parity(powers) == parity
    ]
    itself = tuple(int(i == axis) for i in range(coordinates))
    return itself, *(powers for powers in found if powers != itself)


def _parity(powers: tuple[int, ...]) -> tuple[int, int]:
    return (powers[X] + sum(powers[PSI:])) % 2, (powers[Y] + powers[PHI]) % 2


def _polynomials(
    values: FloatArray, slopes: FloatArray, powers: tuple[tuple[int, ...], ...]
) -> tuple[FloatArray, list[tuple[list[int], FloatArray]]]:
    """Monomials (m, points) of the values; and for each coordinate which of them follow it, and the
    derivatives (followers, points) of these.
    """
    to_the = [np.ones_like(values)]
    for _ in range(DEGREE):
        to_the.append(to_the[-1] * values)
    factors = [
        {i: to_the[exponent][i] for i, exponent in enumerate(exponents) if exponent}
        for exponents in powers
    ]
    functions = np.array([functools.reduce(np.multiply, one.values()) for one in factors])
    derivatives = []
    for i, slope in enumerate(slopes):
        follow = [m for m, exponents in enumerate(powers) if exponents[i]]
        found = np.empty((len(follow), values.shape[1]))
        for row, m in zip(found, follow, strict=True):
            np.multiply(powers[m][i] * slope, to_the[powers[m][i] - 1][i], out=row)
            for k, other in factors[m].items():
                if k != i:
                    row *= other
        derivatives.append((follow, found))
    return functions, derivatives
