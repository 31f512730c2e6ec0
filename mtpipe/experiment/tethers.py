"""Tethers at forces: means and distributions of chains, worked out for many forces at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.physics.tether import Chain, log_distance_density, moments

# Grid of the tether's length: its nodes, and its reach, at most 10 standard deviations from the
# mean and to densities e^-30 of the largest.
GRID_NODES, GRID_SPREADS, GRID_DEPTH = 96, 10.0, 30.0
MOST_KNOWN = 8192


@dataclass(frozen=True, eq=False)
class Tether:
    """A chain at one force: mean and variance of its end's height, variance of its length, and the
    density of the length, on a uniform grid of distances: weights (sum 1) and deviations from the
    mean in standard deviations.
    """

    end_nm: float
    end_variance_nm2: float
    variance_nm2: float
    distance_nm: FloatArray
    weight: FloatArray
    deviation: FloatArray


# Tethers that are known, by chain and force.
_KNOWN: dict[tuple[Chain, float], Tether] = {}


def tethers_at(chain: Chain, forces_pN: Sequence[float]) -> list[Tether]:
    """A chain at several forces; those that are not known are worked out all at once.

    That costs hardly more than one.
    """
    missing = [force for force in forces_pN if (chain, force) not in _KNOWN]
    if missing:
        if len(_KNOWN) > MOST_KNOWN:
            _KNOWN.clear()
            missing = list(forces_pN)
        found = _tethers(chain, np.array(missing))
        _KNOWN.update(((chain, force), one) for force, one in zip(missing, found, strict=True))
    return [_KNOWN[chain, force] for force in forces_pN]


def _tethers(chain: Chain, force_pN: FloatArray) -> list[Tether]:
    found, force = moments(chain, force_pN), force_pN[:, None]
    middle, spread = found.extension_nm, np.sqrt(found.variance_nm2)
    low = np.maximum(middle - GRID_SPREADS * spread, 0.002 * chain.contour_length_nm)
    high = middle + GRID_SPREADS * spread
    if chain.compliance == 0:
        high = np.minimum(high, (1 - 1e-5) * chain.contour_length_nm)
    length = np.linspace(low, high, 4 * GRID_NODES, axis=-1)
    log_density = log_distance_density(chain, force, length)
    there = log_density > log_density.max(axis=-1, keepdims=True) - GRID_DEPTH
    first, last = there.argmax(axis=-1), there.shape[1] - 1 - there[:, ::-1].argmax(axis=-1)
    rows = np.arange(len(length))
    length = np.linspace(length[rows, first], length[rows, last], GRID_NODES, axis=-1)
    log_density = log_distance_density(chain, force, length)
    weight = np.exp(log_density - log_density.max(axis=-1, keepdims=True))
    weight /= weight.sum(axis=-1, keepdims=True)
    deviation = length - np.sum(weight * length, axis=-1, keepdims=True)
    deviation /= np.sqrt(np.sum(weight * deviation**2, axis=-1, keepdims=True))
    known = (found.height_nm, found.height_variance_nm2, found.variance_nm2)
    numbers = np.column_stack(known).tolist()
    return [
        Tether(*of_one, *distribution)
        for of_one, *distribution in zip(numbers, length, weight, deviation, strict=True)
    ]
