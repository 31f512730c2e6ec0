"""Errors of mtpipe's own fits: Cramér–Rao bounds of the models that are fitted, at the truth.

By itself, a trace gives stiffness with its friction free or expected from the setup; in a series x
and y share the force, and all plateaus the bead. What a wrong exposure does follows from the same
derivatives. The likelihood is taken as unbiased: what remains is of second order in the errors.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
from scipy import optimize

from mtpipe.design.force_error import ForceError, left_in_quadrature
from mtpipe.design.motion import AxisMotion, axis_motion, common_errors, empty_spectrum
from mtpipe.design.plan import OVERSTRETCHING_PN, Plan
from mtpipe.fit.estimates import inverse_information
from mtpipe.fit.model import TraceModel
from mtpipe.fit.series import SeriesFit
from mtpipe.fit.series_model import BeadPrior, SeriesModel, SeriesTrace
from mtpipe.ground.types import FloatArray
from mtpipe.setup.conditions import FRICTION_ALLOWANCE

# A series covers its range: beside the plateau in question there are those at which the corner
# frequency along the field is this share of the Nyquist frequency.
COMPANIONS = (1 / 8, 1 / 2)


def error_by_itself(plan: Plan, force_pN: float, axis: int, *, friction_known: bool) -> ForceError:
    """Error of the force from one trace by itself."""
    motion = axis_motion(plan, force_pN, axis)
    model, theta = trace_model(plan, motion, axis, friction_known=friction_known)
    covariance = inverse_information(model.information(theta))
    clean = replace(model, noise_variance_nm2=0.0, noise_prior_nm=None)
    quiet = clean.information(np.array([*theta[:2], 0.0]))
    statistics = 1 / math.sqrt(quiet[0, 0])
    without_noise = math.sqrt(inverse_information(quiet)[0, 0])
    score = (model.slopes(theta) * model.ordinates) @ model.exposure_slope(theta)
    wrong_s = plan.knowledge.exposure * plan.experiment.camera.exposure_s
    return replace(
        common_errors(plan, force_pN, axis),
        statistics=statistics,
        friction=left_in_quadrature(without_noise, statistics),
        noise=left_in_quadrature(math.sqrt(covariance[0, 0]), without_noise),
        exposure=abs(float(covariance[0] @ score)) * wrong_s,
    )


def error_in_series(plan: Plan, force_pN: float) -> ForceError:
    """Error of a force that x and y share in a joint fit with `COMPANIONS`."""
    model, theta = empty_series(plan, force_pN)
    covariance = inverse_information(model.information(theta))
    quiet_model, quiet_theta = empty_series(_without_noise(plan), force_pN)
    # where there is no noise, that is known: its coordinates are left out
    kept = [i for i, name in enumerate(quiet_model.names) if not name.startswith("noise")]
    quiet = quiet_model.information(quiet_theta)[np.ix_(kept, kept)]
    statistics = 1 / math.sqrt(quiet[0, 0])
    without_noise = math.sqrt(inverse_information(quiet)[0, 0])
    noisy = plan != _without_noise(plan)
    wrong_s = plan.knowledge.exposure * plan.experiment.camera.exposure_s
    fit = SeriesFit(model, theta, covariance, np.empty(0), converged=True)
    return replace(
        common_errors(plan, force_pN, plan.experiment.along),
        statistics=statistics,
        friction=left_in_quadrature(without_noise, statistics),
        noise=left_in_quadrature(math.sqrt(covariance[0, 0]), without_noise) if noisy else 0.0,
        exposure=abs(float(fit.shift_per_exposure[0])) * wrong_s if wrong_s else 0.0,
    )


def trace_model(
    plan: Plan, motion: AxisMotion, axis: int, *, friction_known: bool
) -> tuple[TraceModel, FloatArray]:
    """The model that would be fitted to a trace, without data, and the truth (3,)."""
    noise, factor = plan.experiment.tracker.noise_nm[axis], plan.knowledge.noise_factor
    log = noise > 0 and factor is not None
    model = TraceModel(
        empty_spectrum(plan, motion),
        plan.experiment.camera.exposure_s,
        plan.experiment.fluid.thermal_energy_pN_nm,
        noise_variance_nm2=None if noise > 0 else 0.0,
        noise_prior_nm=None if not log or factor is None else (noise, factor),
        friction=(motion.friction, plan.knowledge.friction * motion.friction)
        if friction_known
        else None,
        modes=motion.modes,
    )
    last = math.log(noise**2) if log else noise**2
    return model, np.array([math.log(motion.stiffness), math.log(motion.friction), last])


def empty_series(plan: Plan, force_pN: float) -> tuple[SeriesModel, FloatArray]:
    """Model of the series without data, the force in question first, and the truth."""
    experiment, knowledge = plan.experiment, plan.knowledge
    forces = (force_pN, *companions(plan))
    traces = tuple(
        SeriesTrace(
            number,
            axis,
            plan.state(force).extension_nm,
            trace_model(plan, axis_motion(plan, force, axis), axis, friction_known=False)[0],
        )
        for number, force in enumerate(forces)
        for axis in (0, 1)
    )
    radius, factor = experiment.bead.radius_nm, knowledge.noise_factor
    x, y = (
        None if noise == 0 or factor is None else (noise, factor)
        for noise in experiment.tracker.noise_nm[:2]
    )
    bead = BeadPrior(
        radius_nm=(radius, knowledge.radius * radius),
        viscosity_mPa_s=experiment.fluid.viscosity_mPa_s,
        friction_ln_stderr=math.hypot(knowledge.viscosity, FRICTION_ALLOWANCE),
        noise_nm=(x, y),
        along=experiment.along,
        wall=experiment.fluid.wall,
        rotation=experiment.bead.turns,
    )
    model = SeriesModel(traces, bead, force_shared=True)
    theta = np.zeros(len(model.names))
    theta[model.drives] = np.log(forces)
    if model.radius_free:
        theta[model.ln_radius] = math.log(radius)
    for axis in model.axes:
        variance = experiment.tracker.noise_nm[axis] ** 2
        theta[model.noise(axis)] = math.log(variance) if model.noise_is_log(axis) else variance
    return model, theta


def companions(plan: Plan) -> tuple[float, ...]:
    """Forces of the companions, those that the tether allows."""
    return _companions(_without_noise(plan))


@functools.lru_cache(maxsize=64)
def _companions(plan: Plan) -> tuple[float, ...]:
    """By the plan without noise, on which they do not depend."""
    low, high = math.log(plan.lowest_force_pN), math.log(OVERSTRETCHING_PN)

    def excess_ratio(ln_force: float, share: float) -> float:
        return plan.nyquist_ratio(math.exp(ln_force)) / share - 1

    return tuple(
        math.exp(optimize.brentq(excess_ratio, low, high, args=(share,), xtol=0.05))
        for share in COMPANIONS
        if excess_ratio(low, share) < 0 < excess_ratio(high, share)
    )


@functools.lru_cache(maxsize=64)
def _without_noise(plan: Plan) -> Plan:
    tracker = replace(plan.experiment.tracker, noise_nm=(0.0, 0.0, 0.0))
    return replace(plan, experiment=replace(plan.experiment, tracker=tracker))
