"""From stiffness to force: one trace of a bead, by itself or as part of the bead's series.

Force is stiffness times a lever, the extension along the field, extension and radius across it.
Here the errors of the lever, of kT and of the exposure are added to those of the fit: to a sample
of the posterior, draw by draw.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mtpipe.calibration.bead_results import AxisResult
from mtpipe.calibration.free_fits import LATERAL
from mtpipe.fit.posterior import sample_posterior
from mtpipe.fit.series_posterior import SeriesPosterior
from mtpipe.fit.trace import TraceFit
from mtpipe.ground.errors import FitError
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import AXES
from mtpipe.setup.conditions import Conditions


def sampled_alone(
    alone: AxisResult,
    axis: int,
    extension: tuple[float, float],
    conditions: Conditions,
    generator: np.random.Generator,
) -> AxisResult:
    """A lateral trace by itself with its posterior and force; any other as it is.

    Parameters
    ----------
    alone : its fit. extension : in nm, with its standard error, that of z = 0 included.
    """
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
    per_exposure = alone.fit.shift_per_exposure[0]
    sample = (
        posterior.stiffness_pN_per_nm
        * levers
        * _common(len(levers), per_exposure, conditions, generator)
    )
    return replace(
        alone,
        posterior=posterior,
        force=posterior.restoring(sample, "pN"),
        force_sample_pN=sample,
    )


def of_series(
    series: SeriesPosterior,
    method: str,
    plateau: int,
    axis: int,
    extension: tuple[float, float],
    conditions: Conditions,
    generator: np.random.Generator,
) -> AxisResult | None:
    """What a bead's series says of one trace; None where the trace is not part of it.

    Parameters
    ----------
    method : what the series shares, in words.
    extension : in nm, with its standard error, that of z = 0 included.
    """
    fit, model = series.fit, series.fit.model
    here = {t.axis: t for t in model.traces if t.plateau == plateau}
    if axis not in here:
        return None
    posterior = series.trace(here[axis])
    if conditions.radius_nm is None and axis != conditions.along and not model.force_shared:
        # the lever is extension plus a radius that is not known
        return AxisResult(AXES[axis], method, fit=posterior.fit, posterior=posterior)
    # the share of the extension's error that enters: each axis pulls the force by its information
    members = tuple(here.values()) if model.force_shared else (here[axis],)
    weight = np.array([fit.trace_information(t) for t in members])
    levers = np.array([float(model.lever_nm(fit.theta[None], t)[0]) for t in members])
    relative = extension[1] * float(np.sum(weight / levers) / np.sum(weight))
    draws = np.maximum(1 + relative * generator.normal(size=len(posterior.theta)), 0.0)
    per_exposure = fit.shift_per_exposure[model.drive(here[axis])]
    common = _common(len(draws), per_exposure, conditions, generator)
    sample = series.force_pN(here[axis]) * draws * common
    return AxisResult(
        AXES[axis],
        method,
        fit=posterior.fit,
        posterior=posterior,
        force=posterior.restoring(sample, "pN"),
        force_sample_pN=sample,
        shares_force=len(members) > 1,
    )


def force_alone(
    fit: TraceFit, axis: int, extension: tuple[float, float], conditions: Conditions
) -> Estimate | None:
    """Force from the fit of one trace by itself, without sampling; None without a lever."""
    lever = _lever(axis, extension, conditions)
    if lever is None:
        return None
    relative = math.hypot(
        lever[1] / lever[0],
        conditions.temperature_relative_stderr,
        fit.shift_per_exposure[0] * conditions.exposure_stderr_s,
    )
    return fit.stiffness.scaled(lever[0], "pN").widened(relative)


def effective_radius(
    free: TraceFit, axis: int, extension_nm: float, conditions: Conditions
) -> Estimate | None:
    """Radius whose Stokes friction (with the wall's factor, if listed) the free fit shows.

    None where there is no radius to compare with, or the bead cannot be at that height.
    """
    nominal = conditions.friction_pN_s_per_nm(axis, extension_nm)
    if nominal is None or conditions.radius_nm is None:
        return None
    return free.friction.scaled(conditions.radius_nm[0] / nominal, "nm")


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
