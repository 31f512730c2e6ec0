"""Calibration: from the traces of a recording to stiffness, friction and force with uncertainty.

Per bead, plateau and axis, in two passes. First every trace is fitted freely (stiffness, friction,
noise). Friction over the friction expected from radius, viscosity and height is one number per bead
and axis; where the free fits say that it is what the setup states, the expectation enters the
second fit as prior knowledge, and where they contradict it, the friction that the other plateaus
show on that axis does. Above about half the Nyquist frequency only this keeps errors of the model
from becoming errors of the force (PHYSICS 3.B). The second fit gives stiffness and force; its
posterior is sampled with emcee.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing import get_context

import numpy as np

from mtpipe import refusal
from mtpipe.conditions import Conditions, conditions_of
from mtpipe.errors import FitError
from mtpipe.estimate import Estimate
from mtpipe.exposure import estimate_exposure
from mtpipe.extension import mean_with_stderr
from mtpipe.fit.model import TraceModel
from mtpipe.fit.posterior import Posterior, sample_posterior
from mtpipe.fit.trace import TraceFit, fit_model
from mtpipe.notice import Notice
from mtpipe.recording import AXES, Plateau, Recording
from mtpipe.spectrum import periodogram
from mtpipe.traces import Trace, traces_of

Progress = Callable[[int, int], None]
# Free fits that know the friction worse than this say nothing about the bead's friction.
USEFUL_FRICTION_LN = 0.3
# Beyond this many standard errors the setup's friction is contradicted.
CONTRADICTION_SIGMAS = 4.0


@dataclass(frozen=True)
class AxisResult:
    """Calibration of one bead, plateau and axis.

    `fit` is None where the trace could not be fitted (`refusal` says why). `posterior` is sampled
    on the lateral axes, whose stiffness gives the force; `force` is None for z, where refused, and
    where the tether's extension is not known. `free` is the fit without prior knowledge of the
    friction.
    """

    axis: str
    method: str
    free: TraceFit | None
    fit: TraceFit | None
    posterior: Posterior | None
    force: Estimate | None
    effective_radius: Estimate | None
    refusal: str = ""

    @property
    def estimates(self) -> Posterior | TraceFit | None:
        """Where to read stiffness, friction, noise and corner frequency; None where refused."""
        return None if self.refusal else self.posterior or self.fit


@dataclass(frozen=True)
class PlateauResult:
    """Calibration of one bead in one plateau; extension and its standard error in nm."""

    trace: Trace
    extension_nm: float
    extension_stderr_nm: float
    axes: tuple[AxisResult, ...]

    @property
    def plateau(self) -> Plateau:
        """Where the magnets rested."""
        return self.trace.plateau


@dataclass(frozen=True)
class BeadResult:
    """Calibration of one bead.

    `friction_ratio` is the measured friction over the one expected from the setup (wall included
    if the setup lists it), None where no free fit tells it.
    """

    bead: str
    plateaus: tuple[PlateauResult, ...]
    friction_ratio: Estimate | None
    friction_contradicts: bool


@dataclass(frozen=True)
class Calibration:
    """Calibration of a recording."""

    conditions: Conditions
    beads: tuple[BeadResult, ...]
    notices: tuple[Notice, ...]


def calibrate(
    recording: Recording,
    *,
    seed: int = 0,
    workers: int = 1,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate every tethered bead of a recording (after drift subtraction).

    Parameters
    ----------
    recording : drift already subtracted, if it is to be.
    seed : of the posteriors; each bead's own seed derives from it and the bead's name.
    workers : processes; beads are spread over them.
    progress : called with (beads done, beads).

    Raises
    ------
    SetupError : the frame rate is not known.
    """
    conditions, notices = conditions_of(recording.setup)
    beads = {bead: traces_of(recording, bead) for bead in recording.tethered}
    if recording.setup.camera.exposure_s.value is None:
        exposure, notice = estimate_exposure(recording, beads, conditions)
        conditions = replace(conditions, exposure_s=exposure)
        notices = (*notices, notice)
    lowest_hz = _lowest_frequencies(recording)
    contour = recording.setup.tether.contour_length_nm.value or 0.0
    source = recording.setup.source
    jobs = [
        (
            bead,
            traces,
            conditions,
            lowest_hz,
            contour,
            source is None or source.knows_z_zero(bead),
            seed,
        )
        for bead, traces in beads.items()
    ]
    results: dict[str, BeadResult] = {}
    if workers <= 1 or len(jobs) <= 1:
        for job in jobs:
            results[job[0]] = calibrate_bead(*job)
            if progress is not None:
                progress(len(results), len(jobs))
    else:
        # spawned, not forked: threads of the numerical libraries do not survive a fork
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            futures = {pool.submit(calibrate_bead, *job): job[0] for job in jobs}
            for future in as_completed(futures):
                results[futures[future]] = future.result()
                if progress is not None:
                    progress(len(results), len(jobs))
    return Calibration(conditions, tuple(results[job[0]] for job in jobs), notices)


def calibrate_bead(
    bead: str,
    traces: Sequence[Trace],
    conditions: Conditions,
    lowest_hz: tuple[float, float, float],
    contour_length_nm: float,
    z_is_extension: bool,
    seed: int,
) -> BeadResult:
    """Both passes for one bead.

    Parameters
    ----------
    lowest_hz : per axis, frequency below which drift removal has emptied the spectrum.
    contour_length_nm : as the setup states it, 0 where unknown.
    z_is_extension : False where z = 0 is not the surface; then there is no extension, no force.
    """
    extensions = [
        mean_with_stderr(trace.position_nm[:, 2]) if z_is_extension else (math.nan, math.nan)
        for trace in traces
    ]
    free = [
        [_free_fit(trace, axis, conditions, extension[0], lowest_hz[axis]) for axis in range(3)]
        for trace, extension in zip(traces, extensions, strict=True)
    ]
    refusals = [
        _refusals(trace, fits, conditions, extension[0], contour_length_nm)
        for trace, fits, extension in zip(traces, free, extensions, strict=True)
    ]
    measured = [
        _Friction(i, axis, *ratio)
        for i, fits in enumerate(free)
        for axis in (0, 1)
        if not refusals[i][axis]
        and (ratio := _friction_ratio(fits[axis], conditions, axis, extensions[i][0])) is not None
    ]
    expectation = _FrictionPrior(tuple(measured), conditions.friction_relative_stderr)
    plateaus = []
    for i, (trace, extension) in enumerate(zip(traces, extensions, strict=True)):
        axes = []
        for axis in range(3):
            nominal = conditions.friction_pN_s_per_nm(axis, extension[0])
            axes.append(
                _axis_result(
                    axis,
                    free[i][axis],
                    None if nominal is None else expectation.prior(nominal, i, axis),
                    expectation.contradicted(axis),
                    refusals[i][axis],
                    extension,
                    conditions,
                    np.random.default_rng(_seed(seed, bead, i, axis)),
                )
            )
        plateaus.append(PlateauResult(trace, extension[0], extension[1], tuple(axes)))
    contradicts = any(expectation.contradicted(axis) for axis in (0, 1))
    return BeadResult(bead, tuple(plateaus), _ratio_estimate(measured), contradicts)


@dataclass(frozen=True)
class _Friction:
    """What one free fit says of the bead's friction: ln of measured over expected."""

    plateau: int
    axis: int
    ln_ratio: float
    stderr: float


@dataclass(frozen=True)
class _FrictionPrior:
    """Prior knowledge of friction, from the setup or from the bead's other plateaus."""

    measured: tuple[_Friction, ...]
    allowance: float

    def contradicted(self, axis: int) -> bool:
        """Whether the free fits contradict the setup on this axis (z: on x or on y)."""
        if axis == 2:
            return self.contradicted(0) or self.contradicted(1)
        overall = _combined([m for m in self.measured if m.axis == axis])
        return overall is not None and abs(overall[0]) > CONTRADICTION_SIGMAS * math.hypot(
            overall[1], self.allowance
        )

    def prior(self, nominal: float, plateau: int, axis: int) -> tuple[float, float] | None:
        """Friction and standard error for a trace; None where nothing is known."""
        if not self.contradicted(axis):
            return nominal, nominal * self.allowance
        # without the trace itself, whose friction is in its likelihood already
        others = _combined(
            [m for m in self.measured if axis == 2 or (m.axis == axis and m.plateau != plateau)]
        )
        if others is None:
            return None
        centre = nominal * math.exp(others[0])
        return centre, centre * math.hypot(others[1], self.allowance)


def _ratio_estimate(measured: Sequence[_Friction]) -> Estimate | None:
    overall = _combined(measured)
    if overall is None:
        return None
    value, sigma = math.exp(overall[0]), overall[1]
    interval = (value * math.exp(-sigma), value * math.exp(sigma))
    return Estimate(value, value * sigma, interval, "", "free fits of all plateaus")


def _combined(values: Sequence[_Friction]) -> tuple[float, float] | None:
    """Weighted mean and standard error, widened where the values scatter more than stated."""
    if not values:
        return None
    ln_ratio = np.array([value.ln_ratio for value in values])
    weight = np.array([value.stderr for value in values]) ** -2.0
    mean = float(weight @ ln_ratio / weight.sum())
    error = 1 / math.sqrt(weight.sum())
    if len(values) > 1:
        chi2 = float(weight @ (ln_ratio - mean) ** 2) / (len(values) - 1)
        error *= math.sqrt(max(1.0, chi2))
    return mean, error


def _free_fit(
    trace: Trace, axis: int, conditions: Conditions, extension_nm: float, lowest_hz: float
) -> TraceFit | str:
    """A free fit, or the reason why there is none."""
    try:
        spectrum = periodogram(
            trace.position_nm[:, axis], 1 / conditions.frame_rate_hz, lowest_hz=lowest_hz
        )
    except FitError as error:
        return str(error)
    return fit_model(
        TraceModel(
            spectrum,
            conditions.exposure_s,
            conditions.thermal_energy_pN_nm,
            noise_variance_nm2=None,
            modes=conditions.modes(axis, extension_nm),
        )
    )


def _refusals(
    trace: Trace,
    fits: Sequence[TraceFit | str],
    conditions: Conditions,
    extension_nm: float,
    contour_length_nm: float,
) -> tuple[str, str, str]:
    """Per axis, why the trace is no tethered bead's; empty where it may be one."""
    reasons = [fit if isinstance(fit, str) else refusal.without_plateau(fit) or "" for fit in fits]
    lateral = [(axis, fit) for axis, fit in enumerate(fits[:2]) if not isinstance(fit, str)]
    if len(lateral) == 2:
        relaxation = max(math.exp(fit.theta[1] - fit.theta[0]) for _, fit in lateral)
        frame_s = 1 / conditions.frame_rate_hz
        circling = refusal.driven(trace.position_nm[:, :2], frame_s, relaxation)
        if circling is not None:
            return circling, circling, circling
    tether = max(extension_nm, contour_length_nm) if extension_nm > 0 else contour_length_nm
    still = [refusal.stuck(fit, conditions, axis, tether) for axis, fit in lateral]
    if still and all(still):
        sentence = still[0] or ""
        return sentence, sentence, sentence
    return reasons[0], reasons[1], reasons[2]


def _friction_ratio(
    fit: TraceFit | str, conditions: Conditions, axis: int, extension_nm: float
) -> tuple[float, float] | None:
    """ln of measured over expected friction and its standard error, where the fit knows it."""
    nominal = conditions.friction_pN_s_per_nm(axis, extension_nm)
    if isinstance(fit, str) or nominal is None:
        return None
    stderr = math.sqrt(fit.covariance[1, 1])
    if not stderr < USEFUL_FRICTION_LN:
        return None
    return float(fit.theta[1]) - math.log(nominal), stderr


def _axis_result(
    axis: int,
    free: TraceFit | str,
    prior: tuple[float, float] | None,
    contradicts: bool,
    refused: str,
    extension: tuple[float, float],
    conditions: Conditions,
    generator: np.random.Generator,
) -> AxisResult:
    name = AXES[axis]
    if isinstance(free, str):
        return AxisResult(name, "none", None, None, None, None, None, refused or free)
    method = "spectrum, friction free"
    fit = free
    if prior is not None:
        fit = fit_model(replace(free.model, friction=prior))
        source = "measured on this bead" if contradicts else "expected from the setup"
        method = f"spectrum, friction {source}"
    if refused:
        return AxisResult(name, method, free, fit, None, None, None, refused)
    radius = _effective_radius(free, axis, extension[0], conditions)
    if axis == 2:
        return AxisResult(name, method, free, fit, None, None, radius)
    posterior = sample_posterior(fit, seed=generator)
    force = _force(posterior, axis, extension, conditions, generator)
    return AxisResult(name, method, free, fit, posterior, force, radius)


def _force(
    posterior: Posterior,
    axis: int,
    extension: tuple[float, float],
    conditions: Conditions,
    generator: np.random.Generator,
) -> Estimate | None:
    """Force from stiffness and lever, the lever's own uncertainty included."""
    lever = conditions.lever_nm(axis, extension[0])
    if lever is None:
        return None
    error = extension[1]
    if axis != conditions.along and conditions.radius_nm is not None:
        error = math.hypot(error, conditions.radius_nm[1])
    levers = lever + error * generator.normal(size=len(posterior.theta))
    return posterior.summary(posterior.stiffness_pN_per_nm * np.maximum(levers, 0.0), "pN")


def _effective_radius(
    free: TraceFit, axis: int, extension_nm: float, conditions: Conditions
) -> Estimate | None:
    """Radius whose Stokes friction (with the wall's factor, if listed) the free fit shows."""
    nominal = conditions.friction_pN_s_per_nm(axis, extension_nm)
    if nominal is None or conditions.radius_nm is None:
        return None
    return free.friction.scaled(conditions.radius_nm[0] / nominal, "nm")


def _lowest_frequencies(recording: Recording) -> tuple[float, float, float]:
    drift = recording.drift
    if drift is None or drift.method != "highpass":
        return (0.0, 0.0, 0.0)
    x, y, z = (cutoff or 0.0 for cutoff in drift.cutoff_hz)
    return (x, y, z)


def _seed(seed: int, bead: str, plateau: int, axis: int) -> list[int]:
    name = int.from_bytes(hashlib.sha256(bead.encode()).digest()[:8], "little")
    return [seed, name, plateau, axis]
