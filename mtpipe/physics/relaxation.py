"""Relaxation of an overdamped motion in any potential, from a few functions of its coordinates.

The generator of such a motion is symmetric under the equilibrium density; its slowest
eigenfunctions are approximated within the span of given functions (Rayleigh–Ritz; Noé & Nüske 2013,
Multiscale Model Simul 11:635). Of each function in the span the variance and the speed at which its
correlation begins to fall are exact, whatever the others are; relaxation times are never too long.
A reflecting wall needs nothing but that the density ends there.
"""

from __future__ import annotations

import numpy as np

from mtpipe.physics.camera import FloatArray

# Combinations of functions with less than this share of the variance are rounding error.
ROUNDING = 1e-8


def relaxation_modes(
    weight: FloatArray, functions: FloatArray, slopes: FloatArray, diffusivity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Relaxation of the first function.

    Parameters
    ----------
    weight : (n,) share of each point of the equilibrium; the sum is 1.
    functions : (m, n) at the points, each with mean 0.
    slopes : (coordinates, m, n) their derivatives.
    diffusivity : (coordinates, n) of each coordinate at the points, unit² per second.

    Returns
    -------
    Relaxation times (k,) in s, slowest first, and (k,) the variance that the first function has in
    each; k is at most m.
    """
    covariance = (functions * weight) @ functions.T
    rate = np.zeros_like(covariance)
    for slope, spread in zip(slopes, diffusivity, strict=True):
        rate += (slope * (weight * spread)) @ slope.T
    return modes_of_first(covariance, rate)


def modes_of_first(covariance: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Relaxation of the first of several functions.

    Parameters
    ----------
    covariance, rate : (m, m) of the functions, and how fast their correlations begin to fall.

    Returns
    -------
    Relaxation times (k,) in s, slowest first, and (k,) the variance that the first function has in
    each; k is at most m.
    """
    scale = 1 / np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance * np.outer(scale, scale))
    there = values > ROUNDING * values[-1]
    independent = scale[:, None] * vectors[:, there] / np.sqrt(values[there])
    rates, modes = np.linalg.eigh(independent.T @ rate @ independent)
    amplitude = covariance[0] @ independent @ modes
    return 1 / rates, np.asarray(amplitude**2)
