"""Calibration of one bead: every plateau and axis.

First every trace is fitted for stiffness, friction and noise by itself (`calibration.free_fits`),
and traces that are no tethered bead's are refused. Then the most informed fit that the data support
gives stiffness and force: of the bead's whole series, in which x and y share the force and all
traces the bead (`calibration.series_choice`), or else of each trace by itself, with what all free
fits together say of the friction as prior knowledge (`calibration.friction_prior`). Above about
half the Nyquist frequency only this keeps errors of the model from becoming errors of the force
(PHYSICS 3.B). Posteriors are sampled with emcee.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mtpipe.calibration.bead_forces import effective_radius, force_alone, of_series, sampled_alone
from mtpipe.calibration.bead_prior import bead_prior
from mtpipe.calibration.bead_results import AxisResult, BeadResult, PlateauResult
from mtpipe.calibration.extension import mean_with_stderr
from mtpipe.calibration.free_fits import LATERAL, free_fit, friction_ratio, refusals_of, whole_bead
from mtpipe.calibration.friction_prior import FrictionPrior, MeasuredFriction, ratio_estimate
from mtpipe.calibration.series_choice import SeriesChoice, as_series_trace, choose_series
from mtpipe.fit.series_posterior import SeriesPosterior, sample_series
from mtpipe.fit.trace import TraceFit, fit_model
from mtpipe.ground.errors import FitError
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import AXES
from mtpipe.recording.traces import Trace
from mtpipe.setup.conditions import Conditions


@dataclass(frozen=True)
class Shared:
    """What all beads of a recording share.

    Attributes
    ----------
    lowest_hz : per axis, frequency below which drift removal has emptied the spectrum.
    noise_nm : per axis, the reference beads' tracking noise, or None where there is none.
    contour_length_nm : as the setup states it, 0 where unknown.
    seed : of the posteriors; each bead's and trace's own derives from it.
    not_one_state : by bead and plateau number, why a plateau gives no force to use.
    """

    conditions: Conditions
    lowest_hz: tuple[float, float, float]
    noise_nm: tuple[float | None, float | None, float | None]
    contour_length_nm: float
    seed: int
    not_one_state: Mapping[tuple[str, int], str] = field(default_factory=dict)


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
    bead: str,
    traces: Sequence[Trace],
    z_zero_stderr_nm: float,
    stage_nm2: FloatArray | None,
    shared: Shared,
) -> BeadResult:
    """Calibrate one bead.

    Parameters
    ----------
    z_zero_stderr_nm : of where z = 0 lies; infinite where that is unknown: then there is no
        extension, and no force.
    stage_nm2 : (traces, traces) covariance of their mean z by the stage's motion; None where
        reference beads took it off.
    """
    conditions = shared.conditions
    first = _first_pass(traces, z_zero_stderr_nm, shared)
    expectation = FrictionPrior(first.measured, conditions.friction_relative_stderr)
    contradicts = any(expectation.contradicted(axis) for axis in LATERAL)
    mixed = {
        i: shared.not_one_state[bead, trace.plateau.number]
        for i, trace in enumerate(traces)
        if (bead, trace.plateau.number) in shared.not_one_state
    }
    series = _series(first, shared, _generator(shared.seed, bead), contradicts, set(mixed))
    stage = np.zeros(len(traces)) if stage_nm2 is None else np.sqrt(np.diag(stage_nm2))
    plateaus = []
    for i, (trace, (length, own), moved) in enumerate(
        zip(traces, first.extensions, stage.tolist(), strict=True)
    ):
        extension = (length, math.hypot(own, moved))
        zero = (extension[0], math.hypot(extension[1], z_zero_stderr_nm))
        axes = []
        for axis in first.recorded:
            alone = _alone(first, expectation, i, axis, zero, conditions)
            joint = None
            if series is not None and not alone.refusal and i not in mixed:
                # x and y draw alike: a force they share is one number
                generator = _generator(shared.seed, bead, i)
                choice, posterior = series
                joint = of_series(posterior, choice.words, i, axis, zero, conditions, generator)
            if joint is None:
                generator = _generator(shared.seed, bead, i, axis)
                axes.append(sampled_alone(alone, axis, zero, conditions, generator))
            else:
                axes.append(replace(joint, free=alone.free, force_alone=alone.force_alone,
                                    effective_radius=alone.effective_radius))  # fmt: skip
        plateaus.append(
            PlateauResult(trace, *extension, tuple(axes), mixed.get(i, ""), stage_stderr_nm=moved)
        )
    result = BeadResult(
        bead,
        tuple(plateaus),
        z_zero_stderr_nm,
        ratio_estimate(first.measured),
        contradicts,
        stage_nm2=stage_nm2,
    )
    if series is None:
        return result
    choice, posterior = series
    left_out = tuple((traces[t.plateau].plateau.number, AXES[t.axis]) for t in choice.left_out)
    return replace(result, radius=posterior.radius, series=choice.words, left_out=left_out)


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
    first: _FirstPass,
    shared: Shared,
    generator: np.random.Generator,
    friction_contradicted: bool,
    mixed: Collection[int],
) -> tuple[SeriesChoice, SeriesPosterior] | None:
    """The joint fit of all lateral traces whose extension is known, sampled.

    `mixed` : places of the plateaus that are not one state.
    """
    members = [
        as_series_trace(i, axis, first.extensions[i][0], fit)
        for i, fits in enumerate(first.fits)
        for axis, fit in fits.items()
        if axis in LATERAL
        and i not in mixed
        and isinstance(fit, TraceFit)
        and axis not in first.refusals[i]
        and first.extensions[i][0] > 0
    ]
    if not members:
        return None
    prior = bead_prior(shared.conditions, shared.noise_nm[:2], members)
    choice = choose_series(members, prior, friction_contradicted=friction_contradicted)
    if choice is None:
        return None
    try:
        return choice, sample_series(choice.fit, seed=generator)
    except FitError:
        return None


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
        force_alone=force_alone(fit, axis, extension, conditions),
        effective_radius=effective_radius(free, axis, extension[0], conditions),
    )


def _generator(seed: int, bead: str, *where: int) -> np.random.Generator:
    name = int.from_bytes(hashlib.sha256(bead.encode()).digest()[:8], "little")
    return np.random.default_rng([seed, name, *where])
