"""What one plateau's data are expected to be under a described experiment, at a force.

That is the bead's own motion (`mtpipe.joint_fit.motions`), the noise of tracker and reference, and
lines.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mtpipe.drift.lowpass import response
from mtpipe.experiment.description import Experiment, ForceCourse, Triple, changes_bead
from mtpipe.experiment.readout import recorded_height_nm
from mtpipe.experiment.recorded_modes import recorded_modes
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.data import PlateauData
from mtpipe.joint_fit.height_course import Course, played
from mtpipe.joint_fit.layers import Core, Steady, steady_of
from mtpipe.joint_fit.motions import DIAGONAL, Motion, motions
from mtpipe.joint_fit.random_walk import line_of
from mtpipe.joint_fit.spectra import Transform
from mtpipe.joint_fit.three_axes import inverses
from mtpipe.joint_fit.vibrations import add_line, of_mean_nm2
from mtpipe.physics.camera import Camera, power_spectrum
from mtpipe.physics.walk import walk_variance_s
from mtpipe.spectra.window_power import with_noise

# Heights are not believed better than this: rounding, interpolated formulas, time steps.
LEAST_HEIGHT_STDERR_NM = 0.1
DIFFERENCE = 1e-3
LEAST_POWER = 1e-6


@dataclass(frozen=True)
class Subtraction:
    """What drift subtraction adds to every trace, per axis: reference noise below a cutoff, and
    above it what it leaves of the stage's random walk.
    """

    cutoff_hz: tuple[float | None, float | None, float | None]
    noise_nm: Triple
    stage_nm_per_root_s: Triple = (0.0, 0.0, 0.0)


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
        """Transform of the height's course; None where the force is steady."""
        return None if self.course is None else self.course.transform

    @functools.cached_property
    def inverse(self) -> tuple[FloatArray, FloatArray]:
        """(n_bins, 3, 3) inverse of `random_power`, and (n_bins,) ln of its determinant."""
        return inverses(self.random_power)

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


@dataclass(frozen=True, eq=False)
class Asked:
    """Request for the expectation of one plateau's data; where the force changes, of the mean over
    its time.

    Attributes
    ----------
    data : of the plateau; their values are not read, but which frames there are.
    steady : description of the experiment. course, force_pN : of the force, and its mean.
    """

    data: PlateauData
    steady: Steady
    course: ForceCourse
    force_pN: float


def expectations(subtraction: Subtraction, those: Sequence[Asked]) -> list[Expectation | FitError]:
    """Expectation for each request, or the error that says why there is none: a force too small to
    keep the bead off the surface.

    One call for all is far faster than a call for each, and fastest with the requests of one
    plateau next to each other.
    """
    courses = [_in_course(one) for one in those]
    steady = [
        (one.data, one.steady, force)
        for one, course in zip(those, courses, strict=True)
        for force in ([one.force_pN] if course is None else _forces_of(course))
    ]
    each = iter(_at_steady_forces(subtraction, steady))
    found: list[Expectation | FitError] = []
    for course in courses:
        if course is None:
            found.append(next(each))
        elif isinstance(course, FitError):
            found.append(course)
        else:
            found.append(course.mean_of([next(each) for _ in course.forces_pN]))
    return found


def answered(one: Expectation | FitError) -> Expectation:
    """The answer; raises where there is none."""
    if isinstance(one, FitError):
        raise one.with_traceback(None)
    return one


def _forces_of(course: _InCourse | FitError) -> list[float]:
    return course.forces_pN if isinstance(course, _InCourse) else []


@dataclass(frozen=True, eq=False)
class _InCourse:
    """A plateau during which the force changes.

    Attributes
    ----------
    height_nm : mean over the plateau. course : of the height.
    forces_pN, share : that stand for the plateau's spectra, and for how much of it.
    """

    height_nm: float
    course: Course
    forces_pN: list[float]
    share: FloatArray

    def mean_of(self, those: Sequence[Expectation | FitError]) -> Expectation | FitError:
        """The mean over the plateau's time of what is expected at each of the forces."""
        each = []
        for one in those:
            if isinstance(one, FitError):
                return one
            each.append(one)
        return Expectation(
            np.tensordot(self.share, [one.random_power for one in each], 1),
            self.height_nm,
            float(self.share @ [one.extension_stderr_nm for one in each]),
            self.course,
            each[0].walked_nm2,
            each[0].line_power,
        )


def _in_course(one: Asked) -> _InCourse | FitError | None:
    """None where the force is steady."""
    if one.course.relative_change == 0:
        return None
    play = played(one.data, one.course, one.steady.experiment.camera.frame_s)
    try:
        heights = [height_nm(one.steady, one.force_pN * (1 + node)) for node in play.nodes]
    except FitError as error:
        return error.with_traceback(None)
    course = play.course(np.array(heights))
    forces = (one.force_pN * (1 + play.standing)).tolist()
    return _InCourse(course.mean_nm, course, forces, play.share)


def height_nm(steady: Steady, force_pN: float) -> float:
    """Mean of the recorded z at a steady force.

    Raises
    ------
    FitError : the force is too small to keep the bead off the surface.
    """
    return recorded_height_nm(steady.experiment, steady.moving.core.state(force_pN))


def _at_steady_forces(
    subtraction: Subtraction, those: Sequence[tuple[PlateauData, Steady, float]]
) -> list[Expectation | FitError]:
    """What is expected of experiments at steady forces, or why there is nothing."""
    moved = motions([(data, steady.moving, force) for data, steady, force in those])
    found: list[Expectation | FitError] = []
    for data, together in itertools.groupby(
        zip(those, moved, strict=True), key=lambda one: one[0][0]
    ):
        some = [(steady.experiment, motion) for (_, steady, _), motion in together]
        held = [(e, motion) for e, motion in some if isinstance(motion, Motion)]
        recorded = iter(_recorded(data, subtraction, held) if held else [])
        found += [motion if isinstance(motion, FitError) else next(recorded) for _, motion in some]
    return found


def _recorded(
    data: PlateauData, subtraction: Subtraction, those: Sequence[tuple[Experiment, Motion]]
) -> list[Expectation]:
    """What is expected of motions in one plateau with all that is added to them."""
    added_nm2 = np.array([_added_nm2(data, subtraction, experiment) for experiment, _ in those])
    power = with_noise(
        np.array([motion.power for _, motion in those]),
        2 * data.spectrum.windows[0].frame_s * added_nm2,
        tuple(window.white for window in data.spectrum.windows),
        LEAST_POWER,
    )
    return [
        _with_lines(data, subtraction, experiment, motion, own)
        for (experiment, motion), own in zip(those, power, strict=True)
    ]


def _added_nm2(data: PlateauData, subtraction: Subtraction, experiment: Experiment) -> FloatArray:
    """(n_bins, 3) variance per frame of what tracker and reference add to the motion."""
    stage = experiment.stage
    passed = _passed(data, subtraction, stage.reference_nm, stage.reference_s, experiment.camera)
    return np.asarray(np.square(experiment.tracker.noise_nm) + passed)


def _with_lines(
    data: PlateauData,
    subtraction: Subtraction,
    experiment: Experiment,
    motion: Motion,
    power: FloatArray,
) -> Expectation:
    """What is expected with lines, which are added to the power (n_bins, 3, 3) of all else."""
    stage = experiment.stage
    for line in stage.lines:
        add_line(power, line, data, experiment.clock.dropped_share)
    # what is slow in the reference passes the subtraction whole
    slow = stage.reference_nm[2] ** 2 * min(2 * stage.reference_s / data.duration_s, 1)
    noise_nm2 = experiment.tracker.noise_nm[2] ** 2 + subtraction.noise_nm[2] ** 2
    waves = sum(of_mean_nm2(line, data) for line in stage.lines)
    height_variance = motion.height_variance_nm2 + slow + waves + noise_nm2 / data.frames
    return Expectation(
        power,
        motion.extension_nm + experiment.optics.z_zero_nm,
        math.hypot(math.sqrt(max(height_variance, 0.0)), LEAST_HEIGHT_STDERR_NM),
        None,
        motion.walked_nm2,
        line_of(data).power if motion.walked_nm2.any() else None,
    )


@functools.lru_cache(maxsize=1024)
def _passed(
    data: PlateauData,
    subtraction: Subtraction,
    reference_nm: Triple,
    reference_s: float,
    camera: Camera,
) -> FloatArray:
    """(n_bins, 3) variance per frame of the reference's noise and motion that subtraction passes
    on, and of the stage's that it leaves.
    """
    passed = np.zeros((len(data.spectrum.frequency_hz), 3))
    for axis, size_nm in enumerate(reference_nm):
        added: FloatArray | float = subtraction.noise_nm[axis] ** 2
        if size_nm > 0:
            added = added + size_nm**2 * _unit_reference(data, reference_s, camera)
        if np.any(added):
            passed[:, axis] = _subtraction_gain(data, subtraction.cutoff_hz[axis]) ** 2 * added
        walk_nm = subtraction.stage_nm_per_root_s[axis]
        if walk_nm > 0:
            left = 1 - _subtraction_gain(data, subtraction.cutoff_hz[axis])
            passed[:, axis] += (left * walk_nm) ** 2 * _unit_walk(data, camera.frame_s)
    return passed


@functools.lru_cache(maxsize=1024)
def _unit_reference(data: PlateauData, relaxation_s: float, camera: Camera) -> FloatArray:
    """Variance per frame that motion of 1 nm² has at each frequency."""
    power = power_spectrum(data.spectrum.frequency_hz, 1.0, relaxation_s, camera)
    return np.asarray(power / (2 * camera.frame_s))


@functools.lru_cache(maxsize=1024)
def _unit_walk(data: PlateauData, frame_s: float) -> FloatArray:
    return walk_variance_s(data.spectrum.frequency_hz, frame_s)


@functools.lru_cache(maxsize=1024)
def _subtraction_gain(data: PlateauData, cutoff_hz: float | None) -> FloatArray:
    return response(data.spectrum.frequency_hz, cutoff_hz)


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
    """Force at the second point of a numerical derivative by ln force."""
    return force_pN * math.exp(DIFFERENCE)


def know_states(
    data: Sequence[PlateauData], experiment: Experiment, forces_pN: Sequence[Sequence[float]]
) -> None:
    """Compute and cache the bead's states that expectations will need.

    All together cost little more than one.

    Parameters
    ----------
    data : of each plateau. forces_pN : at which each will be asked for.
    """
    states: dict[Core, list[float]] = {}
    alike = not any(changes_bead(step) for step in experiment.steps)
    common = steady_of(experiment).moving.core
    for plateau, (one, forces) in enumerate(zip(data, forces_pN, strict=True)):
        core = common if alike else steady_of(experiment.in_plateau(plateau)).moving.core
        mine = states.setdefault(core, [])
        mine += forces
        course = experiment.magnets.course(plateau)
        if course.relative_change != 0:
            nodes = played(one, course, experiment.camera.frame_s).nodes
            mine += [force * (1 + node) for force in forces for node in nodes]
    for core, mine in states.items():
        core.know(list(dict.fromkeys(mine)))
