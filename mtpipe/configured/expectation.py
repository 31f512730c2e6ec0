"""What one plateau's data are expected to be under a described experiment, at a force.

Fits ask for the same again and again, since most parameters of an experiment concern one plateau,
or are none of the motion's: what was computed is kept for a while.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mtpipe.configured.data import PlateauData
from mtpipe.configured.layers import Moving, Steady, steady_of
from mtpipe.configured.spectra import Transform
from mtpipe.configured.walk import line_of, sees_walks
from mtpipe.drift.lowpass import response
from mtpipe.experiment.description import (
    Experiment,
    ForceCourse,
    Line,
    Triple,
)
from mtpipe.experiment.readout import force_course, readout, recorded_height_nm
from mtpipe.experiment.state import recorded_modes
from mtpipe.physics.camera import Camera, FloatArray, mean_variance, power_spectrum
from mtpipe.spectrum import expected_matrix

# Heights are not believed better than this: rounding, interpolated formulas, time steps.
LEAST_HEIGHT_STDERR_NM = 0.1
DIFFERENCE = 1e-3
LEAST_POWER = 1e-6
# So many forces stand for a plateau during which the force changes; fewer, and of spectra their
# mean alone, where it changes by less than so much.
COURSE_POINTS, FEWER_POINTS, SMALL_CHANGE = 5, 3, 0.1
DIAGONAL = np.arange(3)


@dataclass(frozen=True)
class Subtraction:
    """What drift subtraction adds to every trace: reference noise below a cutoff, per axis."""

    cutoff_hz: tuple[float | None, float | None, float | None]
    noise_nm: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Course:
    """The height of a plateau during which the force changes.

    Attributes
    ----------
    transform : as of the recorded z. power : (n_bins,) that z has of it.
    """

    transform: Transform
    power: FloatArray


@dataclass(frozen=True, eq=False)
class Expectation:
    """Of one plateau.

    Attributes
    ----------
    random_power : (n_bins, 3, 3) power matrix per bin of what is left to chance.
    extension_nm, extension_stderr_nm : mean height and its standard error, apart from what a random
        walk has moved the bead by since the recording began.
    course : of the height, which is not left to chance; None where the force is steady.
    walked_nm2 : (3,) variance of how far a random walk ends from where it began; `random_power` has
        what is apart from the line between. line_power : (n_bins, 3, 3) of such lines, per nm².
    """

    random_power: FloatArray
    extension_nm: float
    extension_stderr_nm: float
    course: Course | None = None
    walked_nm2: FloatArray = field(default_factory=lambda: np.zeros(3))
    line_power: FloatArray | None = None

    @property
    def course_transform(self) -> Transform | None:
        """Of the height's course; None where the force is steady."""
        return None if self.course is None else self.course.transform

    @functools.cached_property
    def power(self) -> FloatArray:
        """(n_bins, 3, 3) power matrix per bin that a recording should have."""
        if self.course is None and self.line_power is None:
            return self.random_power
        power = self.random_power.copy()
        if self.line_power is not None:
            power[:, DIAGONAL, DIAGONAL] += self.walked_nm2 * self.line_power[:, DIAGONAL, DIAGONAL]
        if self.course is not None:
            power[:, 2, 2] += self.course.power
        return power


def expectation(
    data: PlateauData,
    subtraction: Subtraction,
    experiment: Experiment,
    plateau: int,
    force_pN: float,
) -> Expectation:
    """What a plateau's data should be at a force; the mean over its time where the force changes.

    Parameters
    ----------
    data : of the plateau; their values are not read, but which frames there are.
    plateau : its number, which the experiment may know more about.

    Raises
    ------
    FitError : the force is too small to keep the bead off the surface.
    """
    course = experiment.magnets.course(plateau)
    return _expectation(data, subtraction, steady_of(experiment), course, force_pN)


@functools.lru_cache(maxsize=2048)
def _expectation(
    data: PlateauData,
    subtraction: Subtraction,
    steady: Steady,
    course: ForceCourse,
    force_pN: float,
) -> Expectation:
    if course.relative_change == 0:
        return _at_steady_force(data, subtraction, steady, force_pN)
    relative, nodes = _course_nodes(data, course, steady.experiment.camera.frame_s)
    forces = (force_pN * (1 + nodes)).tolist()
    # heights bend with ln of the force, far less than they rise with it
    rising = np.polynomial.Polynomial.fit(
        np.log1p(nodes), [_height_nm(steady, force) for force in forces], len(nodes) - 1
    )
    heights = rising(np.log1p(np.clip(relative, nodes[0], nodes[-1])))
    if np.ptp(relative) < SMALL_CHANGE:
        forces, share = [force_pN], np.ones(1)
    else:
        # of the time that counts for each node, linear between them; a step needs its two ends
        share = np.array([np.interp(relative, nodes, row).mean() for row in np.eye(len(nodes))])
        counts = share > 1e-3
        forces, share = np.array(forces)[counts].tolist(), share[counts] / share[counts].sum()
    each = [_at_steady_force(data, subtraction, steady, force) for force in forces]
    return Expectation(
        np.tensordot(share, [one.random_power for one in each], 1),
        float(heights.mean()),
        float(share @ [one.extension_stderr_nm for one in each]),
        course_of(data, data.spectrum.transform_of(heights, 2)),
        each[0].walked_nm2,
        each[0].line_power,
    )


@functools.lru_cache(maxsize=256)
def _course_nodes(
    data: PlateauData, course: ForceCourse, frame_s: float
) -> tuple[FloatArray, FloatArray]:
    """Force over its mean, less 1: of each frame, and at the nodes that stand for all of them."""
    relative = force_course(course, round(data.duration_s / frame_s))
    points = FEWER_POINTS if np.ptp(relative) < SMALL_CHANGE else COURSE_POINTS
    return relative, np.linspace(relative.min(), relative.max(), points)


def _height_nm(steady: Steady, force_pN: float) -> float:
    return recorded_height_nm(steady.experiment, steady.moving.core.state(force_pN))


def course_of(data: PlateauData, transform: Transform) -> Course:
    """A course of the height with its transform."""
    return Course(transform, data.spectrum.common_power(transform, transform))


def _at_steady_force(
    data: PlateauData, subtraction: Subtraction, steady: Steady, force_pN: float
) -> Expectation:
    experiment = steady.experiment
    stage, camera = experiment.stage, experiment.camera
    motion = _motion(data, steady.moving, force_pN)
    power = motion.power.copy()
    passed = _passed(data, subtraction, stage.reference_nm, stage.reference_s, camera)
    added_nm2 = np.square(experiment.tracker.noise_nm) + passed
    white = 2 * camera.frame_s * _white(data)[:, DIAGONAL, DIAGONAL]
    own = power[:, DIAGONAL, DIAGONAL] + white * added_nm2
    # dropped frames take white power away; what is left is never none
    power[:, DIAGONAL, DIAGONAL] = np.maximum(own, LEAST_POWER * own.max(axis=0))
    for line in stage.lines:
        _add_line(power, line, data)
    # what is slow in the reference passes the subtraction whole
    slow = stage.reference_nm[2] ** 2 * min(2 * stage.reference_s / data.duration_s, 1)
    noise_nm2 = experiment.tracker.noise_nm[2] ** 2 + subtraction.noise_nm[2] ** 2
    height_variance = motion.height_variance_nm2 + slow + noise_nm2 / data.frames
    return Expectation(
        power,
        motion.extension_nm + experiment.optics.z_zero_nm,
        math.hypot(math.sqrt(max(height_variance, 0.0)), LEAST_HEIGHT_STDERR_NM),
        None,
        motion.walked_nm2,
        line_of(data).power if motion.walked_nm2.any() else None,
    )


@dataclass(frozen=True, eq=False)
class _Motion:
    """What is expected of the bead's own motion.

    Attributes
    ----------
    power : (n_bins, 3, 3). height_variance_nm2 : of the mean height, apart from a random walk's.
    walked_nm2 : (3,) as of `Expectation`.
    """

    power: FloatArray
    extension_nm: float
    height_variance_nm2: float
    walked_nm2: FloatArray


@functools.lru_cache(maxsize=4096)
def _motion(data: PlateauData, moving: Moving, force_pN: float) -> _Motion:
    camera = moving.experiment.camera
    parts = readout(moving.experiment, moving.core.state(force_pN), data.duration_s)
    covariance = parts.covariance_nm2
    power = expected_matrix(data.spectrum.windows, parts.tau_s, covariance, camera.exposure_s)
    if parts.white_nm2.any():
        power += 2 * camera.frame_s * parts.white_nm2 * _white(data)
    # a walk moves the heights of all later plateaus: that is the model's business
    steady = slice(-1) if parts.walks else slice(None)
    variance, tau_s = covariance[steady, 2, 2], parts.tau_s[steady]
    # frames that are lost are taken for time that is lost
    height_variance = float(mean_variance(variance, tau_s, camera, data.frames).sum())
    height_variance += float(parts.white_nm2[2, 2]) / data.frames
    walked_nm2 = np.zeros(3)
    if parts.walks and sees_walks(data):
        gone = -np.expm1(-data.duration_s / parts.tau_s[-1])
        walked_nm2 = 2 * np.diag(covariance[-1]) * gone
        line = line_of(data).power[:, DIAGONAL, DIAGONAL]
        power[:, DIAGONAL, DIAGONAL] -= walked_nm2 * line
    return _Motion(power, parts.extension_nm, height_variance, walked_nm2)


@functools.lru_cache(maxsize=256)
def _white(data: PlateauData) -> FloatArray:
    """(n_bins, 3, 3) what the windows make of white noise of each axis, and common to two."""
    root = np.sqrt([window.white for window in data.spectrum.windows])
    return np.asarray(np.einsum("af,bf->fab", root, root))


@functools.lru_cache(maxsize=1024)
def _passed(
    data: PlateauData,
    subtraction: Subtraction,
    reference_nm: Triple,
    reference_s: float,
    camera: Camera,
) -> FloatArray:
    """(n_bins, 3) variance per frame of the reference's noise and motion that subtraction passes
    on.
    """
    passed = np.zeros((len(data.spectrum.frequency_hz), 3))
    for axis, size_nm in enumerate(reference_nm):
        added: FloatArray | float = subtraction.noise_nm[axis] ** 2
        if size_nm > 0:
            added = added + size_nm**2 * _unit_reference(data, reference_s, camera)
        if np.any(added):
            passed[:, axis] = _subtraction_gain(data, subtraction.cutoff_hz[axis]) * added
    return passed


@functools.lru_cache(maxsize=1024)
def _unit_reference(data: PlateauData, relaxation_s: float, camera: Camera) -> FloatArray:
    """Variance per frame that motion of 1 nm² has at each frequency."""
    power = power_spectrum(data.spectrum.frequency_hz, 1.0, relaxation_s, camera)
    return np.asarray(power / (2 * camera.frame_s))


@functools.lru_cache(maxsize=1024)
def _subtraction_gain(data: PlateauData, cutoff_hz: float | None) -> FloatArray:
    return np.asarray(response(data.spectrum.frequency_hz, cutoff_hz) ** 2)


def _add_line(power: FloatArray, line: Line, data: PlateauData) -> None:
    """Add a vibration's power, in place.

    In what phase the axes vibrate is not known, so each has it by itself.
    """
    wave = _wave(data, line.frequency_hz, line.coherence_s)
    power[:, DIAGONAL, DIAGONAL] += np.square(line.amplitude_nm) * wave


@functools.lru_cache(maxsize=1024)
def _wave(data: PlateauData, frequency_hz: float, coherence_s: float) -> FloatArray:
    """(n_bins, 3) power of a wave of 1 nm, the mean over its phase.

    A wave between two ordinates is in several, and so in two bins where it is at the edge of one.
    """
    spectrum = data.spectrum
    lag_s = spectrum.windows[0].frame_s * np.arange(spectrum.used.shape[1] + 1)
    covariance = np.cos(2 * np.pi * frequency_hz * lag_s) * np.exp(-lag_s / coherence_s) / 2
    return np.column_stack([spectrum.expected_power(covariance, axis) for axis in range(3)])


def changed_spectra(
    data: PlateauData, here: FloatArray, experiment: Experiment, force_pN: float
) -> FloatArray:
    """(3, 2, n_bins) ∂ ln S/∂ ln k and ∂ ln S/∂ ln γ of each axis of a plateau, noise apart.

    A stiffer motion is smaller and faster, more friction makes it slower, all modes alike.

    Parameters
    ----------
    here : (n_bins, 3, 3) expected power.
    """
    parts = recorded_modes(steady_of(experiment).moving.core.state(force_pN))
    changes = np.empty((3, 2, len(here)))
    for axis in range(3):
        window = data.spectrum.windows[axis]
        variance = parts.covariance_nm2[:, axis, axis]
        moved = variance != 0
        for kind, (size, slowness) in enumerate(((-DIFFERENCE, -DIFFERENCE), (0.0, DIFFERENCE))):
            spectra = [
                np.sum(
                    window.expected(
                        variance[moved] * np.exp(sign * size),
                        parts.tau_s[moved] * np.exp(sign * slowness),
                        experiment.camera.exposure_s,
                    ),
                    axis=0,
                )
                for sign in (0.5, -0.5)
            ]
            changes[axis, kind] = (spectra[0] - spectra[1]) / DIFFERENCE / here[:, axis, axis]
    return changes


def larger_pN(force_pN: float) -> float:
    """The force at which it is seen how expectations follow it."""
    return force_pN * math.exp(DIFFERENCE)


def know_states(
    data: Sequence[PlateauData], experiment: Experiment, forces_pN: Sequence[Sequence[float]]
) -> None:
    """Work out the bead's states that expectations will ask for.

    All at once cost little more than one.

    Parameters
    ----------
    data : of each plateau. forces_pN : at which each will be asked for.
    """
    states: list[float] = []
    for plateau, (one, forces) in enumerate(zip(data, forces_pN, strict=True)):
        states += forces
        course = experiment.magnets.course(plateau)
        if course.relative_change != 0:
            nodes = _course_nodes(one, course, experiment.camera.frame_s)[1]
            states += np.multiply.outer(forces, 1 + nodes).ravel().tolist()
    steady_of(experiment).moving.core.know(list(dict.fromkeys(states)))
