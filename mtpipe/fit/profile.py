"""How far a fitted parameter may lie, from the likelihood itself.

Where the bead relaxes within a frame, successive frames hardly correlate, and the likelihood is no
parabola: one side of it may be open though the curvature at its maximum looks sharp. There its
profile is followed (Cox & Hinkley 1974, Theoretical Statistics, section 9.3): a value is in the
interval of 68 % if, all else adapting, −2 ln L rises by less than 1. The likelihood of traces of
few relaxation times is no parabola either, but intervals by its curvature cover there
(docs/validation.md).

Stiffness and friction are told together and their ratio badly, so that the profile is followed in
the relaxation time (and in the noise, where that is fitted); for one of these the likelihood of the
stiffness is a parabola.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtpipe.fit.estimates import inverse_information
from mtpipe.fit.model import PRIOR_HALF_WIDTH, TraceModel
from mtpipe.ground.types import FloatArray

# Below this standard error of a logarithm its likelihood is a parabola for all purposes.
SMALL_LN = 0.1
# Largest factor by which the rise of −2 ln L at one standard error may differ from 1, the rise of a
# parabola.
PARABOLA = 1.5
# Nearest distance in ln relaxation time that is tried, the number of distances to either side, and
# the points to which the profile is interpolated.
NEAREST, POINTS, READ = 0.02, 20, 2000
# Number of noises tried where noise is fitted, and their reach in standard errors.
NOISES, NOISE_REACH = 13, 3.0
# Most Newton steps of the stiffness for each relaxation time; without noise the start is exact.
ITERATIONS = 8
MOVED = 1e-3
STEP = 1e-6


def is_parabola(model: TraceModel, theta: FloatArray, covariance: FloatArray) -> bool:
    """Whether covariance (free, free) at a maximum θ (3,) is a good measure of the errors of
    stiffness and friction.

    It is taken to where the bead does not relax within a frame, or both are known well, or −2 ln L
    rises by 1 one standard error off in the one that is known worse.
    """
    sigma = np.sqrt(np.maximum(np.diag(covariance)[:2], 0.0))
    worse = int(np.argmax(sigma))
    within_frame = np.exp(theta[1] - theta[0]) < model.spectrum.window.frame_s
    if not within_frame or not sigma[worse] > SMALL_LN:
        return True
    if not sigma[worse] < PRIOR_HALF_WIDTH:
        return False
    along = covariance[:, worse] / sigma[worse]
    moved = np.tile(theta, (3, 1))
    moved[0, list(model.free)] += along
    moved[1, list(model.free)] -= along
    if not model.noise_is_log and model.noise_variance_nm2 is None:
        moved[:, 2] = np.maximum(moved[:, 2], 0.0)
    up, down, least = np.sum(model.residuals(moved) ** 2, axis=1)
    rise = np.array([up, down]) - least
    return bool(np.all((rise > 1 / PARABOLA) & (rise < PARABOLA)))


def profile_reach(model: TraceModel, theta: FloatArray, along: FloatArray) -> FloatArray:
    """How far down and up combinations of ln stiffness and ln friction may lie (68 %).

    Parameters
    ----------
    theta : (3,) the maximum.
    along : (n, 2) weights of ln stiffness and ln friction.

    Returns
    -------
    (n, 2) both distances; inf where the likelihood does not fall enough within a factor of e^5 of
    the relaxation time.
    """
    away = np.geomspace(NEAREST, PRIOR_HALF_WIDTH, POINTS)
    offset = np.concatenate([-away[::-1], [0.0], away])
    read = np.interp(np.linspace(0, 2 * POINTS, READ), np.arange(2 * POINTS + 1), offset)
    both = along.sum(axis=1)[:, None]
    least = float(np.sum(model.residuals(theta[None]) ** 2))
    reach = np.zeros((len(along), 2))
    for known, pull in _noises(model, theta):
        ln_stiffness, deviance, width = _likeliest(known, theta[1] - theta[0] + offset)
        # straight where the likelihood is a parabola
        root = np.sqrt(np.maximum(deviance + pull**2 - least, 0.0))
        left = 1.0 - np.interp(read, offset, root) ** 2
        inside = left > 0
        if not inside.any():
            continue
        aside = np.interp(read, offset, width) * np.sqrt(np.maximum(left, 0.0))
        middle = both * np.interp(read, offset, ln_stiffness - theta[0]) + along[:, 1:] * read
        down, up = (np.where(inside, np.abs(both) * aside + sign * middle, 0.0) for sign in (-1, 1))
        for side, distance in enumerate((down, up)):
            farthest = np.argmax(distance, axis=1)
            is_open = inside[farthest] & ((farthest == 0) | (farthest == READ - 1))
            found = np.where(is_open, np.inf, np.max(distance, axis=1))
            reach[:, side] = np.maximum(reach[:, side], found)
    return reach


def _noises(model: TraceModel, theta: FloatArray) -> list[tuple[TraceModel, float]]:
    """Models, each with one possible noise, and the distance of that noise from its prior."""
    if model.noise_variance_nm2 is not None:
        return [(model, 0.0)]
    stderr = float(np.sqrt(inverse_information(model.information(theta))[2, 2]))
    tried = np.tile(theta, (NOISES, 1))
    tried[:, 2] += np.linspace(-NOISE_REACH, NOISE_REACH, NOISES) * stderr
    if not model.noise_is_log:
        low, high = max(tried[0, 2], 0.0), min(tried[-1, 2], model.spectrum.variance_nm2)
        tried[:, 2] = np.linspace(low, high, NOISES)
    return [
        (replace(model, noise_variance_nm2=float(variance), noise_prior_nm=None), float(pull))
        for variance, pull in zip(model.noise_nm2(tried), model.noise_pull(tried), strict=True)
    ]


def _likeliest(model: TraceModel, ln_tau: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """For each relaxation time, friction over stiffness, (n,): the likeliest ln stiffness, −2 ln L
    of it, and its standard error, (n,) each. Noise is known."""
    theta = np.zeros((len(ln_tau), 3))
    theta[:, 1] = ln_tau
    shape = replace(model, noise_variance_nm2=0.0).expected(theta)
    theta[:, 2] = model.noise_variance_nm2
    window = model.spectrum.window
    noise = 2 * window.frame_s * window.white * theta[0, 2]
    power = np.maximum(model.spectrum.power - noise, 0.02 * model.spectrum.power)
    theta[:, :2] -= np.log((power / shape) @ model.ordinates / model.ordinates.sum())[:, None]
    rows = model.residuals(theta)
    step = np.array([STEP, STEP, 0.0])  # of the stiffness, at the same relaxation time
    for _ in range(ITERATIONS):
        slope = (model.residuals(theta + step) - rows) / STEP
        curvature = np.sum(slope**2, axis=1)
        wanted = np.clip(-np.sum(slope * rows, axis=1) / curvature, -1.0, 1.0)
        if np.all(np.abs(wanted) < MOVED):
            break
        theta[:, :2] += wanted[:, None]
        rows = model.residuals(theta)
    return theta[:, 0], np.sum(rows**2, axis=1), 1 / np.sqrt(curvature)
