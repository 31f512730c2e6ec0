"""How much a recording could tell about what is concealed: the proof's measure of strength.

It is a property of the experiments and of no diagnosis: the ln likelihood (nats) by which the true
experiment is expected to beat the configured one, the latter with everything free that is free in
any case: a force per plateau, tracking noise where it is listed, the zero of z (0.3 nm), and what
z is trusted (3 % of its friction, 2 % of its variance). Per bin of n ordinates the expected power
matrices S (true) and B (configured) differ by n (tr B⁻¹S − 3 − ln det B⁻¹S) (Whittle 1953), mean
heights by half the square of their difference in standard errors. Both come from closed forms, with
what the best subtraction leaves: the stage's motion or the reference's noise, whichever is less.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mtpipe.experiment.description import (
    Clock,
    Experiment,
    ForceCourse,
    Optics,
    Rest,
    Stage,
    Tracker,
)
from mtpipe.experiment.readout import force_course, readout
from mtpipe.experiment.recorded_modes import BeadState
from mtpipe.experiment.state import bead_state
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import power_spectrum

BINS = 28
Z_ZERO_NM, HEIGHT_NM = 0.3, 0.1
FRICTION, VARIANCE = 0.03, 0.02
COURSE_NODES = 5
# Ordinates about a line that are taken for themselves.
ABOUT_A_LINE = np.arange(-10, 11)
AXES = range(3)
Change = Callable[[Experiment, float], Experiment]


@dataclass(frozen=True, eq=False)
class Difference:
    """What separates a true experiment from a configured one.

    Attributes
    ----------
    nats : expected gain in ln likelihood.
    force_bias : (plateaus,) relative error of the forces that are fitted without the effect.
    """

    nats: float
    force_bias: FloatArray


@dataclass(frozen=True)
class Size:
    """A number of the configured experiment that is fitted along, from a start."""

    change: Change
    start: float


def difference(true: Experiment, configured: Experiment, sizes: Sequence[Size] = ()) -> Difference:
    """Fit the configured experiment to what the true one is expected to give.

    Parameters
    ----------
    sizes : what else is free.
    """
    lines = tuple(line.frequency_hz for line in true.stage.lines + configured.stage.lines)
    truth = _plateaus(true, true.rests, lines)
    plateaus, noisy = len(truth), any(configured.tracker.noise_nm)
    noise = np.square(configured.tracker.noise_nm) if noisy else np.zeros(0)

    def residuals(theta: FloatArray) -> FloatArray:
        described = configured
        rest_of = theta[plateaus:]
        for size, value in zip(sizes, rest_of[: len(sizes)], strict=True):
            described = size.change(described, float(value))
        zero, friction, variance = rest_of[len(sizes) : len(sizes) + 3]
        allowed = replace(
            described.allowance,
            upward_friction=math.exp(FRICTION * friction),
            upward_variance=math.exp(VARIANCE * variance),
        )
        described = replace(described, allowance=allowed)
        if noisy:
            size_nm = np.sqrt(np.maximum(rest_of[len(sizes) + 3 :], 0.0)).tolist()
            tracker = replace(described.tracker, noise_nm=tuple(size_nm))
            described = replace(described, tracker=tracker)
        rests = [
            replace(rest, force_pN=math.exp(ln_force))
            for ln_force, rest in zip(theta[:plateaus], configured.rests, strict=True)
        ]
        parts = [np.array([zero, friction, variance])]
        those = _plateaus(described, rests, lines)
        for rest, expected, here in zip(rests, truth, those, strict=True):
            course = _course_power(expected, here, rest, true.camera.frame_s, lines)
            parts.append(_residuals(expected, here, course, Z_ZERO_NM * zero))
        return np.concatenate(parts)

    start = np.concatenate(
        [
            np.log([rest.force_pN for rest in true.rests]),
            [size.start for size in sizes],
            np.zeros(3),
            noise,
        ]
    )
    scale = np.concatenate(
        [
            np.full(plateaus, 0.01),
            [max(0.05 * abs(size.start), 1e-6) for size in sizes],
            np.ones(3),
            np.maximum(0.1 * noise, 0.01),
        ]
    )
    lower = np.full(len(start), -np.inf)
    lower[len(start) - len(noise) :] = 0.0
    fit = least_squares(
        residuals, start, bounds=(lower, np.inf), x_scale=scale, diff_step=1e-4, max_nfev=12,
        ftol=1e-3, xtol=1e-6,
    )  # fmt: skip
    return Difference(float(fit.cost), np.expm1(fit.x[:plateaus] - start[:plateaus]))


def size_for(
    nats: float, measure: Callable[[float], float], ends: tuple[float, float], rounds: int = 6
) -> tuple[float, float]:
    """Size at which an effect has a strength, or the nearest that is allowed.

    Parameters
    ----------
    measure : nats of a size; they grow about as its square. ends : smallest and largest size.

    Returns
    -------
    Size, and its nats, within a tenth of those wanted where the ends allow it.
    """
    low, high = (math.log(end) for end in ends)
    here = 0.5 * (low + high)
    for _ in range(rounds):
        found = measure(math.exp(here))
        if abs(math.log(max(found, 1e-6) / nats)) < 0.1:
            break
        low, high = (here, high) if found < nats else (low, here)
        there = here + 0.5 * math.log(nats / max(found, 1e-6))
        # a step that leaves the bracket is halved into it, but the ends themselves are tried
        if there >= high:
            there = high if high == math.log(ends[1]) else 0.5 * (here + high)
        if there <= low:
            there = low if low == math.log(ends[0]) else 0.5 * (low + here)
        if there == here:
            break
        here = there
    return math.exp(here), found


@dataclass(frozen=True, eq=False)
class _Expected:
    """Power matrices (bins, 3, 3) of what is left to chance, how many ordinates each stands for,
    the mean height, and the Fourier transform of its course (frames/2 + 1,), nm, where the force
    changes.
    """

    power: FloatArray
    ordinates: FloatArray
    height_nm: float
    height_stderr_nm: float
    course: NDArray[np.complex128] | float = 0.0


def _plateaus(
    experiment: Experiment, rests: Sequence[Rest], lines_hz: tuple[float, ...]
) -> list[_Expected]:
    magnets = experiment.magnets
    common = replace(experiment, rests=(), magnets=replace(magnets, courses=()))
    return [_plateau(common, magnets.course(i), rest, lines_hz) for i, rest in enumerate(rests)]


def _edges(rest: Rest) -> NDArray[np.int64]:
    """First ordinates of bins that widen, and the one after the last."""
    last = rest.frames // 2 - 1
    return np.unique(np.round(np.geomspace(1, last + 1, BINS + 1)).astype(np.int64))


def _grid(rest: Rest, frame_s: float, lines_hz: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Frequencies and ordinates of bins that widen; each line has ordinates for itself."""
    duration_s = rest.frames * frame_s
    edges = _edges(rest)
    middle = (edges[:-1] + edges[1:] - 1) / 2 / duration_s
    own = np.add.outer(lines_hz, ABOUT_A_LINE / duration_s).ravel()
    return np.append(middle, own), np.append(np.diff(edges), np.ones(len(own)))


@functools.lru_cache(maxsize=512)
def _plateau(
    experiment: Experiment, changing: ForceCourse, rest: Rest, lines_hz: tuple[float, ...]
) -> _Expected:
    if changing.relative_change == 0:
        return _at(experiment, rest, lines_hz)
    course = force_course(changing, rest.frames)
    nodes = np.linspace(course.min(), course.max(), COURSE_NODES)
    each = [
        _at(experiment, replace(rest, force_pN=rest.force_pN * float(1 + node)), lines_hz)
        for node in nodes
    ]
    share = np.array([np.interp(course, nodes, row).mean() for row in np.eye(COURSE_NODES)])
    heights = np.interp(course, nodes, [one.height_nm for one in each])
    power = np.tensordot(share, [one.power for one in each], 1)
    moving = np.asarray(np.fft.rfft(heights - heights.mean()))
    error = float(share @ [one.height_stderr_nm for one in each])
    return _Expected(power, each[0].ordinates, float(heights.mean()), error, moving)


def _course_power(
    true: _Expected, other: _Expected, rest: Rest, frame_s: float, lines_hz: tuple[float, ...]
) -> FloatArray:
    """(bins,) power of the difference of two courses of the height."""
    apart = np.atleast_1d(np.abs(true.course - other.course))
    power = np.broadcast_to(apart**2 * 2 * frame_s / rest.frames, rest.frames // 2 + 1)
    edges = _edges(rest)
    of_lines = np.rint(np.array(lines_hz) * rest.frames * frame_s).astype(int)
    own = np.add.outer(of_lines, ABOUT_A_LINE).ravel()
    return np.append(np.add.reduceat(power, edges)[:-1] / np.diff(edges), power[own])


@functools.lru_cache(maxsize=2048)
def _state(experiment: Experiment, force_pN: float) -> BeadState:
    return bead_state(experiment, force_pN)


def _at(experiment: Experiment, rest: Rest, lines_hz: tuple[float, ...]) -> _Expected:
    camera, stage = experiment.camera, experiment.stage
    dynamics = replace(
        experiment, tracker=Tracker(), stage=Stage(), optics=Optics(), clock=Clock(), steps=()
    )
    parts = readout(experiment, _state(dynamics, rest.force_pN), rest.frames * camera.frame_s)
    frequency, ordinates = _grid(rest, camera.frame_s, lines_hz)
    modes = power_spectrum(frequency[:, None], 1.0, parts.tau_s, camera)
    power = np.einsum("fm,mab->fab", modes, parts.covariance_nm2)
    power = power + 2 * camera.frame_s * parts.white_nm2
    duration_s = rest.frames * camera.frame_s
    for line in stage.lines:
        # ∫ (1 − t/T) e^(−at) dt of the covariance e^(−t/coherence) cos 2πft / 2, once on each side
        rate = 1 / line.coherence_s + 2j * np.pi * (frequency - line.frequency_hz)
        rate = np.where(rate == 0, 1e-9 / duration_s, rate)
        wave = (1 / rate + np.expm1(-rate * duration_s) / (rate**2 * duration_s)).real
        near = np.abs(frequency - line.frequency_hz) * duration_s < ABOUT_A_LINE[-1] + 0.5
        # of the wider bins those of its neighbours have it
        near &= ordinates == 1
        power[near] += np.outer(line.amplitude_nm, line.amplitude_nm) * wave[near, None, None]
    for axis in AXES:
        walk = stage.random_nm_per_root_s[axis] ** 2 / (2 * np.pi**2 * frequency**2)
        noise = 2 * camera.frame_s * experiment.tracker.reference_noise_nm[axis] ** 2
        power[:, axis, axis] += np.minimum(walk, noise)
        if stage.reference_nm[axis] > 0:
            size = stage.reference_nm[axis] ** 2
            own = power_spectrum(frequency, size, stage.reference_s, camera)
            # subtracted is what is slow enough to be the stage's
            power[:, axis, axis] += np.where(walk > noise, own, 0.0)
        # nothing that is recorded has no noise at all; lost frames may take white power away
        floor = 1e-5 * power[:, axis, axis].max()
        power[:, axis, axis] = np.maximum(power[:, axis, axis], floor)
    variance = parts.covariance_nm2[:, 2, 2]
    spread = min(2 * float(variance @ parts.tau_s) / duration_s, float(variance.sum()))
    return _Expected(power, ordinates, parts.extension_nm, math.hypot(math.sqrt(spread), HEIGHT_NM))


def _residuals(
    true: _Expected, other: _Expected, course_power: FloatArray, z_zero_nm: float
) -> FloatArray:
    """Numbers, half the sum of whose squares is what two expectations differ by, in nats."""
    found = []
    correlation = [_correlation(one.power) for one in (true, other)]
    for a in AXES:
        ratio = true.power[:, a, a] / other.power[:, a, a]
        nats = np.maximum(ratio - 1 - np.log(ratio), 0.0)
        found.append(np.sign(ratio - 1) * np.sqrt(2 * true.ordinates * nats))
        for b in range(a):
            apart = correlation[0][:, a, b] - correlation[1][:, a, b]
            found.append(np.sqrt(2 * true.ordinates) * apart)
    # a course is no matter of chance: what two courses differ by counts in full
    found.append(np.sqrt(2 * true.ordinates * course_power / other.power[:, 2, 2]))
    pull = (true.height_nm - other.height_nm - z_zero_nm) / other.height_stderr_nm
    return np.concatenate([*found, [pull]])


def _correlation(power: FloatArray) -> FloatArray:
    size = np.sqrt(np.einsum("faa->fa", power))
    return np.asarray(power / size[:, :, None] / size[:, None, :])
