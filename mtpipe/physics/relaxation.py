"""Relaxation of an overdamped motion in any potential, from a few functions of its coordinates.

The generator of such a motion is symmetric under the equilibrium density; its slowest
eigenfunctions are approximated within the span of given functions (Rayleigh–Ritz; Noé & Nüske 2013,
Multiscale Model Simul 11:635). Of each function in the span the variance and the speed at which its
correlation begins to fall are exact, whatever the others are; relaxation times are never too long.
A reflecting wall needs nothing but that the density ends there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtpipe.ground.types import FloatArray

# Combinations of functions with less than this share of the variance are rounding error.
ROUNDING = 1e-8


def relaxation_matrices(
    weight: FloatArray,
    functions: FloatArray,
    slopes: Sequence[tuple[Sequence[int], FloatArray]],
    diffusivity: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """What sets the relaxation of functions.

    Parameters
    ----------
    weight : (n,) share of each point of the equilibrium; the sum is 1.
    functions : (m, n) at the points, each with mean 0.
    slopes : for each coordinate, which functions follow it, and their derivatives (followers, n).
    diffusivity : (coordinates, n) of each coordinate at the points, unit² per second.

    Returns
    -------
    Covariances (m, m), and how fast correlations begin to fall by each coordinate's diffusion,
    (coordinates, m, m).
    """
    covariance = (functions * weight) @ functions.T
    rates = np.zeros((len(slopes), *covariance.shape))
    for rate, (follow, slope), spread in zip(rates, slopes, diffusivity, strict=True):
        rate[np.ix_(follow, follow)] = (slope * (weight * spread)) @ slope.T
    return covariance, rates


def modes_of_first(covariance: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Relaxation of the first of several functions, of one motion or of many at once.

    Parameters
    ----------
    covariance, rate : (…, m, m) of the functions, and how fast their correlations begin to fall.

    Returns
    -------
    Relaxation times (…, m) in s, slowest first, and (…, m) the variance that the first function has
    in each: 0 for as many as there are combinations of functions that say nothing.
    """
    scale = 1 / np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    values, vectors = np.linalg.eigh(covariance * scale[..., :, None] * scale[..., None, :])
    there = values > ROUNDING * values[..., -1:]
    size = np.where(there, 1 / np.sqrt(np.where(there, values, 1.0)), 0.0)
    independent = scale[..., :, None] * vectors * size[..., None, :]
    turned = np.swapaxes(independent, -1, -2)
    within = turned @ rate @ independent
    # what says nothing is faster than all that does
    fastest = 1 + np.trace(within, axis1=-2, axis2=-1)[..., None]
    diagonal = np.arange(within.shape[-1])
    within[..., diagonal, diagonal] += np.where(there, 0.0, fastest)
    rates, modes = np.linalg.eigh(within)
    amplitude = (covariance[..., :1, :] @ independent @ modes)[..., 0, :]
    return 1 / rates, np.asarray(amplitude**2)
