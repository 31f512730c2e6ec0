"""Calibration of one bead: every plateau and axis.

First every trace is fitted for stiffness, friction and noise by itself (`mtpipe.free_fits`), and
traces that are no tethered bead's are refused. Then the most informed fit that the data support
gives stiffness and force: of the bead's whole series, in which x and y share the force and all
traces the bead (`mtpipe.series_choice`), or else of each trace by itself, with what all free fits
together say of the friction as prior knowledge (`mtpipe.friction_prior`). Above about half the
Nyquist frequency only this keeps errors of the model from becoming errors of the force (PHYSICS
3.B). Posteriors are sampled with emcee.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.bead_results import AxisResult, BeadResult, PlateauResult
from mtpipe.conditions import Conditions
from mtpipe.errors import FitError
from mtpipe.estimate import Estimate
from mtpipe.extension import mean_with_stderr
from mtpipe.fit.posterior import sample_posterior
from mtpipe.fit.series_model import BeadPrior
from mtpipe.fit.series_posterior import SeriesPosterior, sample_series
from mtpipe.fit.trace import TraceFit, fit_model
from mtpipe.free_fits import (
    LATERAL,
    NOISE_FACTOR,
    free_fit,
    friction_ratio,
    refusals_of,
    whole_bead,
)
from mtpipe.friction_prior import FrictionPrior, MeasuredFriction, ratio_estimate
from mtpipe.physics.camera import FloatArray
from mtpipe.physics.tethered_bead import friction_pN_s_per_nm
from mtpipe.recording import AXES
from mtpipe.series_choice import FreeTrace, SeriesChoice, as_series_trace, choose_series
from mtpipe.traces import Trace


@dataclass(frozen=True)
class Shared:
    """What all beads of a recording share.

    Attributes
    ----------
    lowest_hz : per axis, frequency below which drift removal has emptied the spectrum.
    noise_nm : per axis, the reference beads' tracking noise, or None where there is none.
    contour_length_nm : as the setup states it, 0 where unknown.
    seed : of the posteriors; each bead's and trace's own derives from it.
    """

    conditions: Conditions
    lowest_hz: tuple[float, float, float]
    noise_nm: tuple[float | None, float | None, float | None]
    contour_length_nm: float
    seed: int


@dataclass(frozen=True)
class _FirstPass:
    """Per plateau: extension with standard error, free fits and refusals by axis."""

    traces: Sequence[Trace]
    recorded: list[int]
    extensions: list[tuple[float, float]]
    fits: list[dict[int, TraceFit | str]]
    refusals: list[dict[int, str]]
    measured: tuple[MeasuredFriction, ...]


def calibrate_bead(
    bead: str, traces: Sequence[Trace], z_zero_stderr_nm: float, shared: Shared
) -> BeadResult:
    """Calibrate one bead.

    Parameters
    ----------
    z_zero_stderr_nm : of where z = 0 lies; infinite where that is unknown: then there is no
        extension, and no force.
    """
    conditions = shared.conditions
    first = _first_pass(traces, z_zero_stderr_nm, shared)
    expectation = FrictionPrior(first.measured, conditions.friction_relative_stderr)
    contradicts = any(expectation.contradicted(axis) for axis in LATERAL)
    choice = _series(first, shared, friction_contradicted=contradicts)
    posterior = None
    if choice is not None:
        try:
            posterior = sample_series(choice.fit, seed=_generator(shared.seed, bead))
        except FitError:
            choice = None
    plateaus = []
    for i, (trace, extension) in enumerate(zip(traces, first.extensions, strict=True)):
        zero = (extension[0], math.hypot(extension[1], z_zero_stderr_nm))
        axes = []
        for axis in first.recorded:
            alone = _alone(first, expectation, i, axis, zero, conditions)
            # x and y draw alike: a force they share is one number
            joint = _joint(
                choice, posterior, i, axis, zero, conditions, _generator(shared.seed, bead, i)
            )
            if alone.refusal or joint is None:
                generator = _generator(shared.seed, bead, i, axis)
                axes.append(_sampled(alone, axis, zero, conditions, generator))
            else:
                axes.append(replace(joint, free=alone.free, force_alone=alone.force_alone,
                                    effective_radius=alone.effective_radius))  # fmt: skip
        plateaus.append(PlateauResult(trace, extension[0], extension[1], tuple(axes)))
    return BeadResult(
        bead,
        tuple(plateaus),
        z_zero_stderr_nm,
        ratio_estimate(first.measured),
        contradicts,
        None if posterior is None else _radius(posterior),
        "" if choice is None else choice.words,
        ()
        if choice is None
        else tuple((traces[t.plateau].plateau.number, AXES[t.axis]) for t in choice.left_out),
    )


def measured_friction(
    traces: Sequence[Trace], z_zero_stderr_nm: float, shared: Shared
) -> Estimate | None:
    """Friction of one bead over the friction expected from the setup, from free fits alone."""
    return ratio_estimate(_first_pass(traces, z_zero_stderr_nm, shared).measured)


def _first_pass(traces: Sequence[Trace], z_zero_stderr_nm: float, shared: Shared) -> _FirstPass:
    conditions = shared.conditions
    recorded = [axis for axis in range(3) if any(trace.recorded[axis] for trace in traces)]
    extensions = [
        (math.nan, math.nan)
        if math.isinf(z_zero_stderr_nm)
        else mean_with_stderr(trace.position_nm[:, 2])
        for trace in traces
    ]
    fits = [
        {
            axis: free_fit(
                trace, axis, conditions, length[0], shared.lowest_hz[axis], shared.noise_nm[axis]
            )
            for axis in recorded
        }
        for trace, length in zip(traces, extensions, strict=True)
    ]
    refused = [
        refusals_of(trace, of_axes, conditions, length[0], shared.contour_length_nm)
        for trace, of_axes, length in zip(traces, fits, extensions, strict=True)
    ]
    refused = whole_bead(refused, recorded)
    measured = tuple(
        MeasuredFriction(i, axis, *ratio)
        for i, of_axes in enumerate(fits)
        for axis in LATERAL
        if axis in of_axes
        and axis not in refused[i]
        and (ratio := friction_ratio(of_axes[axis], conditions, axis, extensions[i][0])) is not None
    )
    return _FirstPass(traces, recorded, extensions, fits, refused, measured)


def _series(
    first: _FirstPass, shared: Shared, *, friction_contradicted: bool
) -> SeriesChoice | None:
    """The joint fit of all lateral traces whose extension is known."""
    conditions = shared.conditions
    members = [
        as_series_trace(i, axis, first.extensions[i][0], fit)
        for i, fits in enumerate(first.fits)
        for axis, fit in fits.items()
        if axis in LATERAL
        and isinstance(fit, TraceFit)
        and axis not in first.refusals[i]
        and first.extensions[i][0] > 0
    ]
    radius = conditions.radius_nm or _radius_from_friction(members, conditions)
    if not members or radius is None:
        return None
    x, y, _ = (None if noise is None else (noise, NOISE_FACTOR) for noise in shared.noise_nm)
    prior = BeadPrior(
        radius_nm=radius,
        viscosity_mPa_s=conditions.viscosity_mPa_s[0],
        friction_ln_stderr=conditions.friction_stderr_apart_from_radius,
        noise_nm=(x, y),
        along=conditions.along,
        wall=conditions.wall,
        rotation=conditions.rotation,
    )
    return choose_series(members, prior, friction_contradicted=friction_contradicted)


def _radius_from_friction(
    members: Sequence[FreeTrace], conditions: Conditions
) -> tuple[float, float] | None:
    """A first guess of an unknown radius, from the fit that knows the friction best."""
    if not members:
        return None
    best = min(members, key=lambda free: free.fit.covariance[1, 1])
    per_nm = friction_pN_s_per_nm(1.0, 1.0, conditions.viscosity_mPa_s[0], wall=False)
    bulk = math.exp(best.fit.theta[1]) / float(per_nm)
    radius = bulk
    if conditions.wall:
        for _ in range(20):
            raised = friction_pN_s_per_nm(best.trace.extension_nm, radius, 1.0, wall=True)
            radius = (
                bulk
                * radius
                * float(friction_pN_s_per_nm(1.0, 1.0, 1.0, wall=False))
                / float(raised)
            )
    return radius, math.inf


def _alone(
    first: _FirstPass,
    expectation: FrictionPrior,
    plateau: int,
    axis: int,
    extension: tuple[float, float],
    conditions: Conditions,
) -> AxisResult:
    """The fit of one trace by itself, with what is known of its friction; not sampled."""
    free = first.fits[plateau][axis]
    refused = first.refusals[plateau].get(axis, "")
    if isinstance(free, str):
        return AxisResult(AXES[axis], "none", refusal=refused or free)
    nominal = conditions.friction_pN_s_per_nm(axis, extension[0])
    prior = None if nominal is None else expectation.prior(nominal, plateau, axis)
    method, fit = "spectrum, friction free", free
    if prior is not None:
        fit = fit_model(replace(free.model, friction=prior))
        contradicted = expectation.contradicted(axis)
        source = "measured on this bead" if contradicted else "expected from the setup"
        method = f"spectrum, friction {source}"
    alone = AxisResult(AXES[axis], method, free, fit, refusal=refused)
    if refused or axis not in LATERAL:
        return alone
    return replace(
        alone,
        force_alone=_force_alone(fit, axis, extension, conditions),
        effective_radius=_effective_radius(free, axis, extension[0], conditions),
    )


def _sampled(
    alone: AxisResult,
    axis: int,
    extension: tuple[float, float],
    conditions: Conditions,
    generator: np.random.Generator,
) -> AxisResult:
    """A lateral trace by itself with its posterior and force."""
    if alone.refusal or alone.fit is None or axis not in LATERAL:
        return alone
    try:
        posterior = sample_posterior(alone.fit, seed=generator)
    except FitError as error:
        return replace(alone, refusal=str(error))
    lever = _lever(axis, extension, conditions)
    if lever is None:
        return replace(alone, posterior=posterior)
    draws = generator.normal(size=len(posterior.theta))
    levers = np.maximum(lever[0] + lever[1] * draws, 0.0)
    per_exposure = alone.fit.shift_per_exposure()[0]
    sample = (
        posterior.stiffness_pN_per_nm
        * levers
        * _common(len(levers), per_exposure, conditions, generator)
    )
    return replace(
        alone,
        posterior=posterior,
        force=posterior.summary(sample, "pN"),
        force_sample_pN=sample,
    )


def _joint(
    choice: SeriesChoice | None,
    series: SeriesPosterior | None,
    plateau: int,
    axis: int,
    extension: tuple[float, float],
    conditions: Conditions,
    generator: np.random.Generator,
) -> AxisResult | None:
    """What the series says of one trace; None where the trace is not part of it."""
    if choice is None or series is None:
        return None
    model = choice.fit.model
    here = {t.axis: t for t in model.traces if t.plateau == plateau}
    if axis not in here:
        return None
    posterior = series.trace(here[axis])
    # the share of the extension's error that enters: each axis pulls the force by its information
    members = tuple(here.values()) if model.force_shared else (here[axis],)
    weight = np.array([choice.fit.trace_information(t) for t in members])
    levers = np.array([float(model.lever_nm(choice.fit.theta[None], t)[0]) for t in members])
    relative = extension[1] * float(np.sum(weight / levers) / np.sum(weight))
    draws = np.maximum(1 + relative * generator.normal(size=len(posterior.theta)), 0.0)
    per_exposure = choice.fit.shift_per_exposure()[model.drive(here[axis])]
    common = _common(len(draws), per_exposure, conditions, generator)
    if conditions.radius_nm is None and axis != conditions.along and not model.force_shared:
        # the lever is extension plus a radius that nothing tells
        return AxisResult(AXES[axis], choice.words, fit=posterior.fit, posterior=posterior)
    sample = series.force_pN(here[axis]) * draws * common
    return AxisResult(
        AXES[axis],
        choice.words,
        fit=posterior.fit,
        posterior=posterior,
        force=posterior.summary(sample, "pN"),
        force_sample_pN=sample,
        shares_force=len(members) > 1,
    )


def _common(
    n: int, per_exposure: float, conditions: Conditions, generator: np.random.Generator
) -> FloatArray:
    """(n,) factors on the force for what the setup states with an error and all traces share.

    A stiffness is in proportion to kT; `per_exposure` is how far its logarithm moves per second of
    exposure.
    """
    warmth = conditions.temperature_relative_stderr * generator.normal(size=n)
    blur = per_exposure * conditions.exposure_stderr_s * generator.normal(size=n)
    return np.asarray((1 + warmth) * np.exp(np.clip(blur, -2.0, 2.0)))


def _force_alone(
    fit: TraceFit, axis: int, extension: tuple[float, float], conditions: Conditions
) -> Estimate | None:
    """Force from one trace by itself, without sampling."""
    lever = _lever(axis, extension, conditions)
    if lever is None:
        return None
    relative = math.hypot(
        lever[1] / lever[0],
        conditions.temperature_relative_stderr,
        fit.shift_per_exposure()[0] * conditions.exposure_stderr_s,
    )
    return fit.stiffness.scaled(lever[0], "pN").widened(relative)


def _lever(
    axis: int, extension: tuple[float, float], conditions: Conditions
) -> tuple[float, float] | None:
    """Force over stiffness, and its standard error, in nm; None where it is not known."""
    lever, stderr = conditions.lever_nm(axis, extension[0]), extension[1]
    if lever is None:
        return None
    if axis != conditions.along and conditions.radius_nm is not None:
        stderr = math.hypot(stderr, conditions.radius_nm[1])
    return lever, stderr


def _effective_radius(
    free: TraceFit, axis: int, extension_nm: float, conditions: Conditions
) -> Estimate | None:
    """Radius whose Stokes friction (with the wall's factor, if listed) the free fit shows."""
    nominal = conditions.friction_pN_s_per_nm(axis, extension_nm)
    if nominal is None or conditions.radius_nm is None:
        return None
    return free.friction.scaled(conditions.radius_nm[0] / nominal, "nm")


def _radius(posterior: SeriesPosterior) -> Estimate | None:
    """The bead's radius as the series tells it, where it was fitted."""
    if not posterior.fit.model.radius_free:
        return None
    low, middle, high = (float(q) for q in np.quantile(posterior.radius_nm, [0.1587, 0.5, 0.8413]))
    stderr = float(np.std(posterior.radius_nm))
    return Estimate(middle, stderr, (low, high), "nm", "series of spectra, posterior")


def _generator(seed: int, bead: str, *where: int) -> np.random.Generator:
    name = int.from_bytes(hashlib.sha256(bead.encode()).digest()[:8], "little")
    return np.random.default_rng([seed, name, *where])
