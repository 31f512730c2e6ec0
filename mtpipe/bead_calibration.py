"""Calibration of one bead: every plateau and axis, in two passes.

First every trace is fitted for stiffness, friction and noise, the noise known within a factor from
the reference beads, and traces that are no tethered bead's are refused. Then what all these fits
together say of the bead's friction (`mtpipe.friction_prior`) enters the second fit as prior
knowledge. Above about half the Nyquist frequency only this keeps errors of the model from becoming
errors of the force (PHYSICS 3.B). The second fit gives stiffness and force; its posterior is
sampled with emcee.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe import refusal
from mtpipe.conditions import Conditions
from mtpipe.errors import FitError
from mtpipe.estimate import Estimate
from mtpipe.extension import mean_with_stderr
from mtpipe.fit.model import TraceModel
from mtpipe.fit.posterior import Posterior, sample_posterior
from mtpipe.fit.trace import TraceFit, fit_model
from mtpipe.friction_prior import FrictionPrior, MeasuredFriction, ratio_estimate
from mtpipe.physics.camera import FloatArray
from mtpipe.recording import AXES, Plateau
from mtpipe.spectrum import periodogram
from mtpipe.traces import Trace

# Free fits that know the friction worse than this say nothing about the bead's friction.
USEFUL_FRICTION_LN = 0.3
LATERAL = (0, 1)
# Beads differ in their rings, and the tether keeps them out of focus: a tethered bead's tracking
# noise is that of the reference beads within this factor (68 %).
NOISE_FACTOR = 2.0


@dataclass(frozen=True)
class AxisResult:
    """Calibration of one bead, plateau and axis.

    `fit` is None where the trace could not be fitted (`refusal` says why). `posterior` is sampled
    on the lateral axes, whose stiffness gives the force; `force` is None for z, where refused, and
    where the tether's extension is not known; `force_sample_pN` are the draws behind it. `free` is
    the fit without prior knowledge of the friction; the effective radius is read from it, on the
    lateral axes (z mixes in the lateral motion: its friction is no measure of the radius).
    """

    axis: str
    method: str
    free: TraceFit | None
    fit: TraceFit | None
    posterior: Posterior | None
    force: Estimate | None
    effective_radius: Estimate | None
    force_sample_pN: FloatArray | None = None
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

    `z_zero_stderr_nm` is the standard error, common to all plateaus, of where z = 0 lies; the
    forces' errors hold it, the extensions' do not. `friction_ratio` is the measured friction over
    the one expected from the setup (wall included if the setup lists it), None where no free fit
    tells it.
    """

    bead: str
    plateaus: tuple[PlateauResult, ...]
    z_zero_stderr_nm: float
    friction_ratio: Estimate | None
    friction_contradicts: bool


def calibrate_bead(
    bead: str,
    traces: Sequence[Trace],
    conditions: Conditions,
    lowest_hz: tuple[float, float, float],
    contour_length_nm: float,
    z_zero_stderr_nm: float,
    noise_nm: tuple[float | None, float | None, float | None],
    seed: int,
) -> BeadResult:
    """Both passes for one bead.

    Parameters
    ----------
    lowest_hz : per axis, frequency below which drift removal has emptied the spectrum.
    contour_length_nm : as the setup states it, 0 where unknown.
    z_zero_stderr_nm : of where z = 0 lies; infinite where that is unknown: then there is no
        extension, and no force.
    noise_nm : per axis, the reference beads' tracking noise, or None where there is none.
    """
    recorded = [axis for axis in range(3) if any(trace.recorded[axis] for trace in traces)]
    extensions = [
        (math.nan, math.nan)
        if math.isinf(z_zero_stderr_nm)
        else mean_with_stderr(trace.position_nm[:, 2])
        for trace in traces
    ]
    free = [
        {
            axis: _free_fit(trace, axis, conditions, length[0], lowest_hz[axis], noise_nm[axis])
            for axis in recorded
        }
        for trace, length in zip(traces, extensions, strict=True)
    ]
    refusals = [
        _refusals(trace, fits, conditions, length[0], contour_length_nm)
        for trace, fits, length in zip(traces, free, extensions, strict=True)
    ]
    refusals = _whole_bead(refusals, recorded)
    measured = tuple(
        MeasuredFriction(i, axis, *ratio)
        for i, fits in enumerate(free)
        for axis in LATERAL
        if axis in fits
        and axis not in refusals[i]
        and (ratio := _friction_ratio(fits[axis], conditions, axis, extensions[i][0])) is not None
    )
    expectation = FrictionPrior(measured, conditions.friction_relative_stderr)
    plateaus = []
    for i, (trace, extension) in enumerate(zip(traces, extensions, strict=True)):
        axes = []
        for axis in recorded:
            nominal = conditions.friction_pN_s_per_nm(axis, extension[0])
            axes.append(
                _axis_result(
                    axis,
                    free[i][axis],
                    None if nominal is None else expectation.prior(nominal, i, axis),
                    expectation.contradicted(axis),
                    refusals[i].get(axis, ""),
                    (extension[0], math.hypot(extension[1], z_zero_stderr_nm)),
                    conditions,
                    np.random.default_rng(_seed(seed, bead, i, axis)),
                )
            )
        plateaus.append(PlateauResult(trace, extension[0], extension[1], tuple(axes)))
    contradicts = any(expectation.contradicted(axis) for axis in LATERAL)
    return BeadResult(
        bead, tuple(plateaus), z_zero_stderr_nm, ratio_estimate(measured), contradicts
    )


def _free_fit(
    trace: Trace,
    axis: int,
    conditions: Conditions,
    extension_nm: float,
    lowest_hz: float,
    noise_nm: float | None,
) -> TraceFit | str:
    """A fit without prior knowledge of the friction, or the reason why there is none."""
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
            noise_prior_nm=None if not noise_nm else (noise_nm, NOISE_FACTOR),
            modes=conditions.modes(axis, extension_nm),
        )
    )


def _refusals(
    trace: Trace,
    fits: Mapping[int, TraceFit | str],
    conditions: Conditions,
    extension_nm: float,
    contour_length_nm: float,
) -> dict[int, str]:
    """Axes on which the trace is no tethered bead's, and why."""
    lateral = {
        axis: fit for axis, fit in fits.items() if axis in LATERAL and isinstance(fit, TraceFit)
    }
    if len(lateral) == 2:
        relaxation = max(math.exp(fit.theta[1] - fit.theta[0]) for fit in lateral.values())
        circling = refusal.driven(
            trace.position_nm[:, :2], 1 / conditions.frame_rate_hz, relaxation
        )
        if circling is not None:
            return dict.fromkeys(fits, circling)
    tether = max(extension_nm, contour_length_nm) if extension_nm > 0 else contour_length_nm
    still = [refusal.stuck(fit, conditions, axis, tether) for axis, fit in lateral.items()]
    if still and all(still):
        return dict.fromkeys(fits, still[0] or "")
    reasons = {
        axis: fit
        if isinstance(fit, str)
        else refusal.without_plateau(fit, conditions.friction_pN_s_per_nm(axis, extension_nm))
        for axis, fit in fits.items()
    }
    return {axis: reason for axis, reason in reasons.items() if reason is not None}


def _whole_bead(refusals: list[dict[int, str]], recorded: list[int]) -> list[dict[int, str]]:
    """Refuse all traces of a bead that is no tethered bead in half of its lateral traces or more.

    Chance then decides which of the others look like a tether's.
    """
    lateral = [axis for axis in recorded if axis in LATERAL]
    reasons = [plateau[axis] for plateau in refusals for axis in lateral if axis in plateau]
    if not reasons or 2 * len(reasons) < len(refusals) * len(lateral):
        return refusals
    usual = Counter(reasons).most_common(1)[0][0]
    return [{axis: plateau.get(axis, usual) for axis in recorded} for plateau in refusals]


def _friction_ratio(
    fit: TraceFit | str, conditions: Conditions, axis: int, extension_nm: float
) -> tuple[float, float] | None:
    """ln of measured over expected friction and its standard error, where the fit knows it."""
    nominal = conditions.friction_pN_s_per_nm(axis, extension_nm)
    if isinstance(fit, str) or nominal is None:
        return None
    stderr = math.sqrt(fit.covariance[1, 1])
    ln_ratio = float(fit.theta[1]) - math.log(nominal)
    # a fit that took drift or noise for the tether's motion says nothing about the bead
    if not stderr < USEFUL_FRICTION_LN or ln_ratio > math.log(refusal.IMPLAUSIBLE_FRICTION):
        return None
    return ln_ratio, stderr


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
        return AxisResult(name, "none", None, None, None, None, None, refusal=refused or free)
    method = "spectrum, friction free"
    fit = free
    if prior is not None:
        fit = fit_model(replace(free.model, friction=prior))
        source = "measured on this bead" if contradicts else "expected from the setup"
        method = f"spectrum, friction {source}"
    if refused:
        return AxisResult(name, method, free, fit, None, None, None, refusal=refused)
    if axis == 2:
        return AxisResult(name, method, free, fit, None, None, None)
    radius = _effective_radius(free, axis, extension[0], conditions)
    try:
        posterior = sample_posterior(fit, seed=generator)
    except FitError as error:
        return AxisResult(name, method, free, fit, None, None, None, refusal=str(error))
    sample = _force_sample(posterior, axis, extension, conditions, generator)
    force = None if sample is None else posterior.summary(sample, "pN")
    return AxisResult(name, method, free, fit, posterior, force, radius, sample)


def _force_sample(
    posterior: Posterior,
    axis: int,
    extension: tuple[float, float],
    conditions: Conditions,
    generator: np.random.Generator,
) -> FloatArray | None:
    """(n_samples,) force from stiffness and lever, with the errors of lever and temperature."""
    lever = conditions.lever_nm(axis, extension[0])
    if lever is None:
        return None
    error = extension[1]
    if axis != conditions.along and conditions.radius_nm is not None:
        error = math.hypot(error, conditions.radius_nm[1])
    n = len(posterior.theta)
    levers = np.maximum(lever + error * generator.normal(size=n), 0.0)
    # a stiffness is in proportion to kT
    warmth = 1 + conditions.temperature_relative_stderr * generator.normal(size=n)
    return posterior.stiffness_pN_per_nm * levers * warmth


def _effective_radius(
    free: TraceFit, axis: int, extension_nm: float, conditions: Conditions
) -> Estimate | None:
    """Radius whose Stokes friction (with the wall's factor, if listed) the free fit shows."""
    nominal = conditions.friction_pN_s_per_nm(axis, extension_nm)
    if nominal is None or conditions.radius_nm is None:
        return None
    return free.friction.scaled(conditions.radius_nm[0] / nominal, "nm")


def _seed(seed: int, bead: str, plateau: int, axis: int) -> list[int]:
    name = int.from_bytes(hashlib.sha256(bead.encode()).digest()[:8], "little")
    return [seed, name, plateau, axis]
