"""Exact simulator of a tethered bead before a camera: every mode in one step per frame.

What is linear costs the same whatever the stiffness: second-order statistics (spectra, variances,
correlations between axes) are those of the closed forms exactly. z is shorter by what the tether
swings, and moves itself in the chain's potential (`mtpipe.simulation.axial`). What is not in it
(lateral friction that follows the momentary height, the surface as a wall, kurtosis across) is in
`mtpipe.simulation.brownian`, to which stretches go whose state asks for it. What swinging and
length do to each other, and hydrodynamic memory, come last, as what they make of the power at each
frequency.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.sparse.csgraph import connected_components

from mtpipe.experiment.recorded_modes import UP, BeadState, followed_modes, recorded_modes
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import (
    Camera,
    blur_factor,
    edge_factor,
    frame_variance,
    lag_one_covariance,
    power_spectrum,
)
from mtpipe.physics.langevin import mode_path
from mtpipe.physics.normal_numbers import standard_normal
from mtpipe.simulation.axial import MOST_KNOWN, simulate_heights
from mtpipe.simulation.rocking import simulate_rocking

# Products of modes are averaged over parts of the exposure of at most one relaxation time, but over
# no more than three parts. Fluctuations of a product within a part are nearly independent from
# frame to frame; they are added by their exact variance and lag-one covariance.
PART_RELAXATIONS = 1.0
MOST_PARTS = 3
# Below this share of the largest, an amplitude or an element of the bending is rounding error.
ROUNDING = 1e-10
# Points of a gain over frequency, between which it is a straight line.
GAIN_POINTS = 400
LEAST_GAIN = 1e-6
# Relaxation times after which a motion is forgotten.
FORGOTTEN = 20.0


def simulate_motion(
    stretches: Sequence[tuple[BeadState, int]],
    camera: Camera,
    random: np.random.Generator,
    *,
    unseen: Collection[int] = (),
) -> FloatArray:
    """Recorded motion of one bead through stretches of constant force.

    Parameters
    ----------
    stretches : state of the bead and number of frames, in time order. The first starts in
        equilibrium, every other where the one before left the bead.
    unseen : which of them nobody looks at, so that it only matters where they leave the bead.

    Returns
    -------
    (frames, 3) x, y, z in nm, averaged over each exposure; z from the surface, x and y about the
    anchor. In stretches that are not seen, the mean.
    """
    pieces = []
    position: FloatArray | None = None
    for i, (state, frames) in enumerate(stretches):
        if state.stepped is not None:
            # numba is loaded where there are steps only
            from mtpipe.simulation.stepped import stepped

            motion, position = stepped(state, state.stepped, camera, frames, random, position)
        else:
            start: FloatArray | None = None
            if position is not None:
                start = np.asarray(np.linalg.solve(state.modes.shape, position - _mean(state)))
            if state.rocking is not None:
                motion, end = simulate_rocking(state, state.rocking, camera, frames, random, start)
            elif i in unseen:
                end = _end_of_stretch(state, camera, frames, random, start)
            else:
                motion, end = _stretch(state, camera, frames, random, start)
            position = state.modes.shape @ end + _mean(state)
        if i in unseen:
            motion = np.tile([0.0, 0.0, state.extension_nm], (frames, 1))
        else:
            _give_power(motion, state, camera)
        pieces.append(motion)
    return np.vstack(pieces)


def _give_power(motion: FloatArray, state: BeadState, camera: Camera) -> None:
    """Give (frames, 3) motion as it was followed the power at each frequency that it has."""
    frequency = fft.rfftfreq(len(motion), camera.frame_s)
    known, gains = _gains(state, camera)
    for axis, gain in gains.items():
        mean = motion[:, axis].mean()
        content = fft.rfft(motion[:, axis] - mean) * np.interp(frequency, known, gain)
        motion[:, axis] = mean + fft.irfft(content, len(motion))


@functools.lru_cache(maxsize=MOST_KNOWN)
def _gains(state: BeadState, camera: Camera) -> tuple[FloatArray, dict[int, FloatArray]]:
    """Frequencies (n,) and what recorded amplitudes (n,) there are over those that were followed,
    of each axis of which they differ.
    """
    frequency = np.append(0.0, np.geomspace(1e-5, 1.0, GAIN_POINTS) * camera.nyquist_hz)
    gains = {}
    both = recorded_modes(state), followed_modes(state)
    # x and y are followed as they are, but for memory
    for axis in range(3) if state.memory_s > 0 else (2,):
        powers = []
        for modes in both:
            variance = modes.covariance_nm2[:, axis, axis]
            there = variance != 0
            each = power_spectrum(frequency[:, None], variance[there], modes.tau_s[there], camera)
            powers.append(each.sum(axis=-1))
        gain = np.sqrt(powers[0] / powers[1])
        if np.max(np.abs(gain - 1)) > LEAST_GAIN:
            gains[axis] = gain
    return frequency, gains


def _mean(state: BeadState) -> FloatArray:
    """(d,) mean of the coordinates, measured from the anchor."""
    mean = np.zeros(len(state.modes.tau_s))
    mean[UP] = state.extension_nm
    return mean


@dataclass(frozen=True, eq=False)
class _Product:
    """Two modes whose product moves z, by `weight`; `offset` is taken off its mean."""

    first: int
    second: int
    weight: float
    offset: float


@dataclass(frozen=True, eq=False)
class _Plan:
    """What of a state and a camera does not change from simulation to simulation.

    Attributes
    ----------
    amplitude_nm : (3, d). blocks : modes that bend z together, the parts in which an exposure is
        averaged for them, and their products. within : `_within_parts` of all products.
    """

    amplitude_nm: FloatArray
    blocks: tuple[tuple[tuple[int, ...], int, tuple[_Product, ...]], ...]
    within: tuple[float, float]


@functools.lru_cache(maxsize=MOST_KNOWN)
def _plan(state: BeadState, camera: Camera) -> _Plan:
    modes = state.modes
    q = modes.quadratic(state.bending)
    q = np.where(np.abs(q) > ROUNDING * np.abs(q).max(), q, 0.0)
    amplitude = modes.amplitude_nm
    amplitude = np.where(np.abs(amplitude) > ROUNDING * np.abs(amplitude).max(), amplitude, 0.0)
    within = np.zeros(2)
    blocks = []
    for block in _blocks(q):
        if state.upward in block:
            continue
        # the mode that bends z most sets how finely its square is followed
        leading = max(block, key=lambda i: abs(q[i, i]))
        part_count = _parts(camera.exposure_s / float(modes.tau_s[leading]))
        products = []
        for i, j in itertools.combinations_with_replacement(block, 2):
            if q[i, j] == 0:
                continue
            weight = float(q[i, j]) * (0.5 if i == j else 1.0)
            taus = float(modes.tau_s[i]), float(modes.tau_s[j])
            within += (2 if i == j else 1) * weight**2 * _within_parts(taus, camera, part_count)
            # the mean of what the square has within a part is taken off here already
            kept = blur_factor(camera.exposure_s / part_count / taus[0]) if i == j else 0.0
            products.append(_Product(i, j, weight, float(kept)))
        blocks.append((tuple(block), part_count, tuple(products)))
    return _Plan(amplitude, tuple(blocks), (float(within[0]), float(within[1])))


def _stretch(
    state: BeadState,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    start: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """(frames, 3) motion, and the modes at its end."""
    plan, modes, up = _plan(state, camera), state.modes, state.upward
    recorded = np.zeros((3, frames))
    end = np.empty(len(modes.tau_s))
    recorded[2], end[up] = _heights(state, camera, frames, random, start)
    for block, part_count, products in plan.blocks:
        paths = {
            i: mode_path(
                float(modes.tau_s[i]),
                camera,
                frames,
                random,
                start=None if start is None else float(start[i]),
                parts=part_count,
            )
            for i in block
        }
        for i in block:
            end[i] = paths[i].end
            mean = _over_parts(paths[i].averages)
            for axis in np.flatnonzero(plan.amplitude_nm[:, i]):
                recorded[axis] += plan.amplitude_nm[axis, i] * mean
        for one in products:
            averages = paths[one.first].averages * paths[one.second].averages
            recorded[2] += one.weight * (_over_parts(averages) - one.offset)
    recorded[2] += _moving_average(*plan.within, frames, random)
    return recorded.T, end


def _heights(
    state: BeadState,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    start: FloatArray | None,
) -> tuple[FloatArray, float]:
    """(frames,) recorded heights, and their mode at the end."""
    of_one = float(state.modes.shape[UP, state.upward])
    before = None if start is None else state.extension_nm + of_one * float(start[state.upward])
    heights, last = simulate_heights(state.axial, camera, frames, random, before)
    return heights, (last - state.extension_nm) / of_one


def _end_of_stretch(
    state: BeadState,
    camera: Camera,
    frames: int,
    random: np.random.Generator,
    start: FloatArray | None,
) -> FloatArray:
    """The modes at the end of a stretch, of which nothing else is asked."""
    modes, up = state.modes, state.upward
    end = random.standard_normal(len(modes.tau_s))
    if start is not None:
        past = frames * camera.frame_s / modes.tau_s
        end = np.exp(-past) * start + np.sqrt(-np.expm1(-2 * past)) * end
    # earlier heights are forgotten
    enough = math.ceil(FORGOTTEN * float(state.axial.modes[0].max()) / camera.frame_s)
    _, end[up] = _heights(state, camera, min(frames, enough), random, start)
    return end


def _over_parts(averages: FloatArray) -> FloatArray:
    """(frames,) mean over the parts (parts, frames) of each exposure."""
    return averages[0] if len(averages) == 1 else np.asarray(averages.mean(axis=0))


def _parts(relaxations: float) -> int:
    return min(max(math.ceil(relaxations / PART_RELAXATIONS), 1), MOST_PARTS)


def _blocks(q: FloatArray) -> list[list[int]]:
    """Modes that bend z together; modes that do not bend it stand alone."""
    _, block_of = connected_components(q != 0, directed=False)
    return [np.flatnonzero(block_of == block).tolist() for block in range(block_of.max() + 1)]


def _within_parts(taus_s: tuple[float, float], camera: Camera, parts: int) -> FloatArray:
    """(2,) variance and lag-one covariance of two modes' product that its parts do not have.

    The product itself is one mode that relaxes at the sum of both rates.
    """
    part_s = camera.exposure_s / parts
    both_s = 1 / sum(1 / tau for tau in taus_s)
    whole = frame_variance(1.0, both_s, camera), lag_one_covariance(1.0, both_s, camera)
    number = np.arange(parts)
    missing = []
    for lag, exact in enumerate(whole):
        apart = np.abs(lag * camera.frame_s + part_s * (number[:, None] - number))
        of_parts = np.ones((parts, parts))
        for tau in taus_s:
            pause = np.maximum(apart - part_s, 0.0)
            other = edge_factor(part_s / tau) ** 2 * np.exp(-pause / tau)
            of_parts *= np.where(apart > 0, other, blur_factor(part_s / tau))
        missing.append(float(exact) - float(of_parts.mean()))
    return np.maximum(missing, 0.0)


def _moving_average(
    variance: float, lag_one: float, frames: int, random: np.random.Generator
) -> FloatArray:
    """(frames,) of e_n + θ e_(n-1): Gaussian, of this variance and (up to half of it) lag one."""
    ratio = min(lag_one / variance, 0.5) if variance > 0 else 0.0
    theta = 2 * ratio / (1 + math.sqrt(1 - 4 * ratio**2))
    kicks = math.sqrt(variance / (1 + theta**2)) * standard_normal(random, frames + 1)
    return np.asarray(kicks[1:] + theta * kicks[:-1])
