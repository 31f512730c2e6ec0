"""The model of one bead's whole series: all plateaus, along and across the field together.

What the traces share is fitted once: a plateau's force (k = F/L along the field, F/(L + R) across),
the bead's radius, the scale of its friction, and each axis's tracking noise. Friction follows the
height (Faxén) and rotation couples across the field where the experiment has that. A force at four
times the Nyquist frequency, lost to a fit of its own trace, is found because friction and noise are
known from the other plateaus.

Coordinates θ = (ln force per plateau, or ln stiffness per trace where x and y do not share it;
ln radius, where it is not known exactly; ln friction scale; noise variance in nm² per axis, or its
logarithm where it has a prior). Everything works on many θ at once, as in `mtpipe.fit.model`.
Extensions are taken as measured; their errors enter the forces afterwards.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.fit.model import LARGEST_LN_NOISE, PRIOR_HALF_WIDTH, TraceModel
from mtpipe.ground.types import FloatArray
from mtpipe.physics.modes import SINGLE_MODE, Modes
from mtpipe.physics.tethered_bead import friction_pN_s_per_nm, lever_nm, turning_modes

DERIVATIVE_STEP = 1e-4
# Half-width of the flat prior in ln R about a radius that is not known.
RADIUS_HALF_WIDTH = 1.0


@dataclass(frozen=True, eq=False)
class SeriesTrace:
    """One trace of the series: its plateau (any number), axis (0, 1), extension, and spectrum.

    `model` is that of the trace by itself; its noise, friction and modes are not used.
    """

    plateau: int
    axis: int
    extension_nm: float
    model: TraceModel

    @functools.cached_property
    def bare(self) -> TraceModel:
        """The model with its noise as a variance to be fitted."""
        return replace(self.model, noise_variance_nm2=None, noise_prior_nm=None)


@dataclass(frozen=True)
class BeadPrior:
    """What is known beforehand of the bead and its surroundings.

    Attributes
    ----------
    radius_nm : value and standard error; 0: exact, infinite: not known (the value is a start).
    viscosity_mPa_s : with it and the radius the friction is expected.
    friction_ln_stderr : of measured over expected friction, apart from the radius's part; infinite:
        nothing is known.
    noise_nm : per axis (x, y), median of the tracking noise and the factor that holds 68 %, or
        None: its variance is flat.
    along : the axis along the field, 0 or 1.
    wall, rotation : whether the surface's friction and the bead's rotation are part of the physics.
    """

    radius_nm: tuple[float, float]
    viscosity_mPa_s: float
    friction_ln_stderr: float
    noise_nm: tuple[tuple[float, float] | None, tuple[float, float] | None]
    along: int
    wall: bool
    rotation: bool


@dataclass(frozen=True)
class SeriesModel:
    """Likelihood and priors of a bead's series."""

    traces: tuple[SeriesTrace, ...]
    bead: BeadPrior
    force_shared: bool

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        kind = "ln_force" if self.force_shared else "ln_stiffness"
        drives = ["_".join([kind, *map(str, drive)]) for drive in self._drives]
        radius = ["ln_radius"] if self.radius_free else []
        return (*drives, *radius, "ln_friction_scale", *(f"noise_{a}" for a in self.axes))

    @property
    def radius_free(self) -> bool:
        """Whether the radius is a coordinate; only the lever and the wall tell it from friction."""
        return self.bead.radius_nm[1] > 0 and (
            self.force_shared or math.isfinite(self.bead.radius_nm[1])
        )

    @functools.cached_property
    def axes(self) -> tuple[int, ...]:
        """The axes that are part of the series."""
        return tuple(sorted({trace.axis for trace in self.traces}))

    @property
    def drives(self) -> list[int]:
        """Indices of the forces or stiffnesses; they come first."""
        return list(range(len(self._drives)))

    @functools.cached_property
    def _drives(self) -> tuple[tuple[int, ...], ...]:
        """What each force or stiffness belongs to: (plateau,) or (plateau, axis)."""
        return tuple(dict.fromkeys(self._drive_of(trace) for trace in self.traces))

    def _drive_of(self, trace: SeriesTrace) -> tuple[int, ...]:
        return (trace.plateau,) if self.force_shared else (trace.plateau, trace.axis)

    def drive(self, trace: SeriesTrace) -> int:
        """Index of the coordinate that holds a trace's force or stiffness."""
        return self._place[self._drive_of(trace)]

    @functools.cached_property
    def _place(self) -> dict[tuple[int, ...], int]:
        return {drive: i for i, drive in enumerate(self._drives)}

    @property
    def ln_radius(self) -> int:
        """Index of the coordinate ln radius, where the radius is free."""
        return self.names.index("ln_radius")

    @property
    def friction_scale(self) -> int:
        """Index of the coordinate ln friction scale."""
        return self.names.index("ln_friction_scale")

    def noise(self, axis: int) -> int:
        """Index of an axis's noise coordinate."""
        return self.names.index(f"noise_{axis}")

    def noise_is_log(self, axis: int) -> bool:
        """Whether an axis's noise coordinate is ln ε² and not ε²."""
        return self.bead.noise_nm[axis] is not None

    def is_variance(self, coordinate: int) -> bool:
        """Whether a coordinate is a noise variance ε² ≥ 0; all others are logarithms."""
        is_noise = self.names[coordinate].startswith("noise")
        return is_noise and not self.noise_is_log(self.axis_of(coordinate))

    def axis_of(self, coordinate: int) -> int:
        """Axis of a noise coordinate."""
        return int(self.names[coordinate].removeprefix("noise_"))

    def radius_nm(self, theta: FloatArray) -> FloatArray:
        """(n,) radius."""
        if self.radius_free:
            return np.asarray(np.exp(theta[:, self.ln_radius]))
        return np.full(len(theta), self.bead.radius_nm[0])

    def lever_nm(self, theta: FloatArray, trace: SeriesTrace) -> FloatArray:
        """(n,) force over stiffness: L along the field, L + R across."""
        along = trace.axis == self.bead.along
        return lever_nm(trace.extension_nm, self.radius_nm(theta), along=along)

    def coordinates(self, theta: FloatArray, trace: SeriesTrace) -> FloatArray:
        """(n, 3) coordinates of one trace as in `mtpipe.fit.model`, its noise as variance."""
        return np.asarray(self.coordinates_of(theta, (trace,))[0])

    def coordinates_of(self, theta: FloatArray, traces: Sequence[SeriesTrace]) -> FloatArray:
        """(traces, n, 3) the same of several traces at once."""
        lengths = np.array([trace.extension_nm for trace in traces])
        radius = self.radius_nm(theta)[:, None]
        out = np.empty((len(traces), len(theta), 3))
        out[:, :, 0] = theta[:, [self.drive(trace) for trace in traces]].T
        if self.force_shared:
            along = np.array([trace.axis == self.bead.along for trace in traces])
            out[:, :, 0] -= np.log(lever_nm(lengths, radius, along=along)).T
        expected = friction_pN_s_per_nm(
            lengths, radius, self.bead.viscosity_mPa_s, wall=self.bead.wall
        )
        out[:, :, 1] = (np.log(expected) + theta[:, [self.friction_scale]]).T
        for axis in self.axes:
            noise = theta[:, self.noise(axis)]
            here = [trace.axis == axis for trace in traces]
            out[here, :, 2] = np.exp(noise) if self.noise_is_log(axis) else noise
        return out

    def modes(self, theta: FloatArray, trace: SeriesTrace) -> Modes:
        """Relaxation modes of one trace, arrays (n,)."""
        return self.modes_of(theta, (trace,))[0]

    def modes_of(self, theta: FloatArray, traces: Sequence[SeriesTrace]) -> list[Modes]:
        """The same of several traces at once."""
        turning = [t for t in traces if self.bead.rotation and t.axis != self.bead.along]
        if not turning:
            return [SINGLE_MODE] * len(traces)
        lengths = np.array([trace.extension_nm for trace in turning])
        radius = self.radius_nm(theta)[:, None]
        together = turning_modes(lengths, radius, wall=self.bead.wall)
        return [
            SINGLE_MODE if trace not in turning else together.of((..., turning.index(trace)))
            for trace in traces
        ]

    def motions(self, theta: FloatArray) -> list[tuple[FloatArray, Modes]]:
        """Coordinates and modes of every trace."""
        modes = self.modes_of(theta, self.traces)
        return list(zip(self.coordinates_of(theta, self.traces), modes, strict=True))

    def expected(self, theta: FloatArray, trace: SeriesTrace) -> FloatArray:
        """Expected binned periodogram of one trace, (n, n_bins) nm²/Hz."""
        return trace.bare.expected(self.coordinates(theta, trace), self.modes(theta, trace))

    def residuals(self, theta: FloatArray) -> FloatArray:
        """(n, all bins + priors), the squares of which sum to −2 ln of likelihood × prior."""
        parts = [
            trace.model.deviance_roots(trace.bare.expected(at, modes))
            for trace, (at, modes) in zip(self.traces, self.motions(theta), strict=True)
        ]
        return np.hstack([*parts, self._pulls(theta)])

    @functools.cached_property
    def common(self) -> list[int]:
        """Indices of the coordinates that all traces share: all but forces and stiffnesses."""
        return list(range(len(self._drives), len(self.names)))

    def log_prior(self, theta: FloatArray) -> FloatArray:
        """(n,) of the common coordinates, up to a constant; −inf where not allowed."""
        scale = self.friction_scale
        allowed = np.abs(theta[:, scale] - self.start[scale]) < PRIOR_HALF_WIDTH
        if self.radius_free:
            allowed &= (
                np.abs(theta[:, self.ln_radius] - math.log(self.bead.radius_nm[0]))
                < RADIUS_HALF_WIDTH
            )
        for axis in self.axes:
            noise = theta[:, self.noise(axis)]
            log = self.noise_is_log(axis)
            allowed &= np.abs(noise) < LARGEST_LN_NOISE if log else noise >= 0
        out = np.full(len(theta), -np.inf)
        out[allowed] = -0.5 * np.sum(self._pulls(theta[allowed]) ** 2, axis=1)
        return out

    def slopes(self, theta: FloatArray) -> list[tuple[list[int], FloatArray]]:
        """Per trace, which coordinates move it, and (those, n_bins): how its ln power follows."""
        return self._derivatives(theta, lambda _, power: np.log(power))

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """(residuals, dimensions) derivatives of the residuals at one θ."""
        blocks = []
        for mine, slope in self._derivatives(theta, lambda t, p: t.model.deviance_roots(p)):
            block = np.zeros((slope.shape[1], len(theta)))
            block[:, mine] = slope.T
            blocks.append(block)
        return np.vstack([*blocks, self._pull_slopes(theta).T])

    def _derivatives(
        self, theta: FloatArray, of: Callable[[SeriesTrace, FloatArray], FloatArray]
    ) -> list[tuple[list[int], FloatArray]]:
        """Per trace, which coordinates move it, and (those, n_bins) derivatives of what `of` makes
        of its expected power."""
        low, high = self.around(theta)
        width = np.sum(high - low, axis=1)[:, None]
        found = []
        for trace, (at, modes) in zip(
            self.traces, self.motions(np.vstack([low, high])), strict=True
        ):
            mine = [self.drive(trace), *self.common]
            rows = [*mine, *(len(theta) + i for i in mine)]
            value = of(trace, trace.bare.expected(at[rows], modes.of(rows)))
            found.append((mine, (value[len(mine) :] - value[: len(mine)]) / width[mine]))
        return found

    def _pull_slopes(self, theta: FloatArray) -> FloatArray:
        """(dimensions, number of priors) derivatives of the pulls."""
        low, high = self.around(theta)
        width = np.sum(high - low, axis=1)[:, None]
        return np.asarray((self._pulls(high) - self._pulls(low)) / width)

    def around(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Below and above one θ, (dimensions, dimensions) each: a row per coordinate moved."""
        shift = np.diag(DERIVATIVE_STEP * self.units)
        low, high = theta - shift, theta + shift
        for axis in self.axes:
            if not self.noise_is_log(axis):
                low[:, self.noise(axis)] = np.maximum(low[:, self.noise(axis)], 0.0)
        return low, high

    @functools.cached_property
    def units(self) -> FloatArray:
        """Size of a natural step in each coordinate."""
        units = np.ones(len(self.names))
        for axis in self.axes:
            if not self.noise_is_log(axis):
                variances = [t.model.spectrum.variance_nm2 for t in self.traces if t.axis == axis]
                units[self.noise(axis)] = min(variances)
        return units

    def information(self, theta: FloatArray) -> FloatArray:
        """Expected Fisher information at one θ, priors included."""
        information = np.zeros((len(theta), len(theta)))
        for (mine, slope), trace in zip(self.slopes(theta), self.traces, strict=True):
            information[np.ix_(mine, mine)] += (slope * trace.model.ordinates) @ slope.T
        pulls = self._pull_slopes(theta)
        return np.asarray(information + pulls @ pulls.T)

    def _pulls(self, theta: FloatArray) -> FloatArray:
        """(n, number of priors) distances from the priors in their standard errors."""
        pulls = []
        radius, stderr = self.bead.radius_nm
        if self.radius_free and math.isfinite(stderr):
            pulls.append((self.radius_nm(theta) - radius) / stderr)
        if math.isfinite(self.bead.friction_ln_stderr):
            pulls.append(theta[:, self.friction_scale] / self.bead.friction_ln_stderr)
        for axis in self.axes:
            prior = self.bead.noise_nm[axis]
            if prior is not None:
                ratio = theta[:, self.noise(axis)] / 2 - math.log(prior[0])
                pulls.append(ratio / math.log(prior[1]))
        return np.column_stack(pulls) if pulls else np.empty((len(theta), 0))

    @functools.cached_property
    def start(self) -> FloatArray:
        """(dimensions,) from the starts of the traces by themselves, given friction and noise."""
        theta = np.zeros(len(self.names))
        if self.radius_free:
            theta[self.ln_radius] = math.log(self.bead.radius_nm[0])
        for axis in self.axes:
            prior = self.bead.noise_nm[axis]
            theta[self.noise(axis)] = (
                2 * math.log(prior[0]) if prior else 0.05 * self.units[self.noise(axis)]
            )
        sums: dict[int, list[float]] = {}
        for trace in self.traces:
            friction = float(np.exp(self.coordinates(theta[None], trace)[0, 1]))
            known = replace(
                trace.model,
                friction=(friction, 0.03 * friction),
                modes=self.modes(theta[None], trace),
            )
            ln_lever = math.log(float(self.lever_nm(theta[None], trace)[0]))
            found = known.start[0] + (ln_lever if self.force_shared else 0.0)
            sums.setdefault(self.drive(trace), []).append(float(found))
        for index, values in sums.items():
            theta[index] = np.mean(values)
        return theta
