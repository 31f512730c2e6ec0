"""Likelihood of a bead's whole recording under one described experiment.

Unknowns are a force per plateau, shared by x, y, z and the extension, and few `Parameter`s of the
experiment: what the setup states with an error or not at all, the tracking noise, and whatever an
effect brings along. A parameter is a change of the description, so that anything an experiment can
be described with can be fitted.

Per bin the power matrix of n ordinates is complex Wishart about its expectation S (Whittle 1953;
Brillinger 1981, theorem 7.2.4), −n (ln det S + tr S⁻¹P); the mean height is Gaussian about the
chain's with the variance that S has at zero frequency.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.configured.data import PlateauData
from mtpipe.drift.lowpass import response
from mtpipe.experiment.description import (
    Clock,
    Experiment,
    Line,
    Optics,
    Rest,
    Stage,
    Tracker,
)
from mtpipe.experiment.parameter import Parameter
from mtpipe.experiment.readout import force_course, readout
from mtpipe.experiment.state import BeadState, bead_state, recorded_modes
from mtpipe.physics.camera import FloatArray, power_spectrum

# Heights are not believed better than this: rounding, interpolated formulas, time steps.
LEAST_HEIGHT_STDERR_NM = 0.1
DIFFERENCE = 1e-3
LEAST_POWER = 1e-6
# Forces that stand for a plateau during which the force changes.
COURSE_POINTS = 5


@dataclass(frozen=True)
class Subtraction:
    """What drift subtraction adds to every trace: reference noise below a cutoff, per axis."""

    cutoff_hz: tuple[float | None, float | None, float | None]
    noise_nm: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Expectation:
    """Of one plateau: power matrix per bin (n_bins, 3, 3), mean height and its standard error."""

    power: FloatArray
    extension_nm: float
    extension_stderr_nm: float


@functools.lru_cache(maxsize=4096)
def _state(core: Experiment, force_pN: float) -> BeadState:
    return bead_state(core, force_pN)


def _core(experiment: Experiment) -> Experiment:
    """The part of the description that the bead's motion depends on."""
    return replace(
        experiment,
        rests=(),
        tracker=Tracker(),
        stage=Stage(),
        optics=Optics(),
        clock=Clock(),
        hopping=None,
        magnets=replace(experiment.magnets, courses=()),
    )


@dataclass(frozen=True, eq=False)
class ConfiguredModel:
    """One bead's data and the experiment that is to explain them.

    The coordinates θ are ln force per plateau, then the parameters.
    """

    data: tuple[PlateauData, ...]
    experiment: Experiment
    parameters: tuple[Parameter, ...]
    subtraction: Subtraction

    @property
    def plateaus(self) -> int:
        """Number of plateaus, and of forces in θ."""
        return len(self.data)

    @property
    def lower(self) -> FloatArray:
        """Lowest allowed θ."""
        return np.array([-12.0] * self.plateaus + [p.lower for p in self.parameters])

    @property
    def upper(self) -> FloatArray:
        """Highest allowed θ."""
        return np.array([6.0] * self.plateaus + [p.upper for p in self.parameters])

    def described(self, theta: FloatArray) -> Experiment:
        """The experiment at θ."""
        experiment = self.experiment
        for parameter, value in zip(self.parameters, theta[self.plateaus :], strict=True):
            experiment = parameter.change(experiment, float(value))
        rests = tuple(
            Rest(float(np.exp(ln_force)), rest.frames, rest.magnet_mm)
            for ln_force, rest in zip(theta[: self.plateaus], experiment.rests, strict=True)
        )
        return replace(experiment, rests=rests)

    def expected(self, experiment: Experiment, plateau: int, force_pN: float) -> Expectation:
        """What one plateau's data should be; the mean over its time where the force changes."""
        changing = experiment.magnets.course(plateau)
        if changing.relative_change == 0:
            return self._expected_at(experiment, plateau, force_pN)
        data = self.data[plateau]
        course = force_course(changing, round(data.duration_s / experiment.camera.frame_s))
        nodes = np.linspace(course.min(), course.max(), COURSE_POINTS)
        each = [
            self._expected_at(experiment, plateau, float(force_pN * (1 + node))) for node in nodes
        ]
        # share of the time that counts for each node, linear between them
        share = np.array([np.interp(course, nodes, row).mean() for row in np.eye(COURSE_POINTS)])
        heights = np.interp(course, nodes, [one.extension_nm for one in each])
        power = np.tensordot(share, [one.power for one in each], 1)
        power[:, 2, 2] += data.spectrum.power_of(heights, 2)
        return Expectation(
            power,
            float(heights.mean()),
            float(share @ [one.extension_stderr_nm for one in each]),
        )

    def _expected_at(self, experiment: Experiment, plateau: int, force_pN: float) -> Expectation:
        data, camera = self.data[plateau], experiment.camera
        state = _state(_core(experiment), force_pN)
        parts = readout(experiment, state, data.duration_s)
        windows = data.spectrum.windows
        kernels: list[FloatArray] = []
        for axis in range(3):
            moved = np.flatnonzero(parts.covariance_nm2[:, axis, axis])
            kernel = np.zeros((len(parts.tau_s), len(data.spectrum.frequency_hz)))
            kernel[moved] = windows[axis].expected(
                np.ones(len(moved)), parts.tau_s[moved], camera.exposure_s
            )
            kernels.append(kernel)
        power = np.zeros((len(data.spectrum.frequency_hz), 3, 3))
        level = 2 * camera.frame_s
        for a in range(3):
            for b in range(a, 3):
                variance, white = parts.covariance_nm2[:, a, b], parts.white_nm2[a, b]
                if not variance.any() and white == 0:
                    continue
                kernel = kernels[a] if a == b else np.sqrt(kernels[a] * kernels[b])
                flat = np.sqrt(windows[a].white * windows[b].white)
                power[:, a, b] = power[:, b, a] = variance @ kernel + level * white * flat
            power[:, a, a] += level * windows[a].white * self._passed(experiment, a, data)
            # dropped frames take white power away; what is left is never none
            power[:, a, a] = np.maximum(power[:, a, a], LEAST_POWER * power[:, a, a].max())
        for line in experiment.stage.lines:
            _add_line(power, line, data)
        height_variance = 2 * float(parts.covariance_nm2[:, 2, 2] @ parts.tau_s) / data.duration_s
        height_variance = min(height_variance, float(parts.covariance_nm2[:, 2, 2].sum()))
        return Expectation(
            power,
            parts.extension_nm,
            float(np.hypot(np.sqrt(height_variance), LEAST_HEIGHT_STDERR_NM)),
        )

    def _passed(self, experiment: Experiment, axis: int, data: PlateauData) -> FloatArray:
        """Variance per frame of the reference's noise and motion that subtraction passes on."""
        frequency = data.spectrum.frequency_hz
        gain = response(frequency, self.subtraction.cutoff_hz[axis]) ** 2
        size = experiment.stage.reference_nm[axis]
        own = np.zeros_like(frequency)
        if size > 0:
            camera = experiment.camera
            own = power_spectrum(frequency, size**2, experiment.stage.reference_s, camera)
            own = own / (2 * camera.frame_s)
        return np.asarray(gain * (self.subtraction.noise_nm[axis] ** 2 + own))

    def all_expected(self, theta: FloatArray) -> list[Expectation]:
        """What all plateaus' data should be at θ."""
        experiment = self.described(theta)
        return [
            self.expected(experiment, i, rest.force_pN) for i, rest in enumerate(experiment.rests)
        ]

    def log_likelihood(self, expected: list[Expectation], theta: FloatArray) -> float:
        """ln likelihood × prior, up to a constant."""
        total = -0.5 * float(np.sum(self.pulls(theta) ** 2))
        for data, model in zip(self.data, expected, strict=True):
            total += float(np.sum(spectral_log_likelihood(data, model.power)))
            pull = (data.mean_nm[2] - model.extension_nm) / model.extension_stderr_nm
            total -= 0.5 * pull**2 + np.log(model.extension_stderr_nm)
        return total

    def pulls(self, theta: FloatArray) -> FloatArray:
        """Distances of the parameters from their priors, in standard errors; 0 without one."""
        return np.array(
            [
                0.0 if p.prior is None else (value - p.prior[0]) / p.prior[1]
                for p, value in zip(self.parameters, theta[self.plateaus :], strict=True)
            ]
        )


def _add_line(power: FloatArray, line: Line, data: PlateauData) -> None:
    """Add a vibration's power, in place, to the bin that holds its frequency."""
    frequency = data.spectrum.frequency_hz
    at = int(np.argmin(np.abs(frequency - line.frequency_hz)))
    width = data.spectrum.ordinates[at] / data.duration_s
    size = np.asarray(line.amplitude_nm)
    gain = np.sqrt([data.spectrum.gain(axis)[at] for axis in range(3)])
    power[at] += np.outer(size * gain, size * gain) / 2 / width


def changed_spectra(model: ConfiguredModel, theta: FloatArray, plateau: int) -> FloatArray:
    """(3, 2, n_bins) ∂ ln S/∂ ln k and ∂ ln S/∂ ln γ of each axis of a plateau, noise apart.

    A stiffer motion is smaller and faster, more friction makes it slower, all modes alike.
    """
    experiment = model.described(theta)
    rest, data = experiment.rests[plateau], model.data[plateau]
    parts = recorded_modes(_state(_core(experiment), rest.force_pN))
    here = model.expected(experiment, plateau, rest.force_pN).power
    changes = np.empty((3, 2, len(here)))
    for axis in range(3):
        window = data.spectrum.windows[axis]
        variance = parts.covariance_nm2[:, axis, axis]
        moved = variance > 0
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


def spectral_log_likelihood(data: PlateauData, power: FloatArray) -> FloatArray:
    """(n_bins,) −n (ln det S + tr S⁻¹P) of each bin."""
    inverse = np.linalg.inv(power)
    trace = np.einsum("fab,fba->f", inverse, data.spectrum.power)
    return np.asarray(-data.spectrum.ordinates * (np.linalg.slogdet(power)[1] + trace))
