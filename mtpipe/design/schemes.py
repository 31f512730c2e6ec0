"""Errors of other methods of the field: what they make of the spectrum that is expected.

They know one relaxation mode. Bias is what the method gives for the expected spectrum itself;
scatter follows from the spectrum's, and from what the method has to be told. Noise that is known
is subtracted; noise that is not known is not, and biases.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy import optimize

from mtpipe.design.arctangent import ExpectedArctangent, expected_arctangent
from mtpipe.design.force_error import NO_FORCE, ForceError, left_in_quadrature
from mtpipe.design.motion import axis_motion, common_errors
from mtpipe.design.plan import Plan
from mtpipe.experiment.state import expected_spectrum
from mtpipe.ground.types import FloatArray
from mtpipe.methods.integrated_spectrum import Correction
from mtpipe.physics.camera import Camera, frame_variance

# Ordinates below the corner frequency: enough for the integral of the spectrum.
BELOW_CORNER = 30
FEWEST_ORDINATES = 256
# Steps in ln f of integrals over a spectrum.
LN_STEP = 0.02
DERIVATIVE_STEP = 0.01


def error_of_equipartition(plan: Plan, force_pN: float, axis: int) -> ForceError:
    """Error of the force from the variance, corrected for blur with the friction expected."""
    camera, knowledge = plan.experiment.camera, plan.knowledge
    energy = plan.experiment.fluid.thermal_energy_pN_nm
    motion = axis_motion(plan, force_pN, axis)
    noise_nm2, unsure_nm2 = _noise(plan, axis)
    seen_nm2, stderr_nm2, stderr_without_noise_nm2 = _variance(plan, force_pN, axis)
    corrected_nm2 = seen_nm2 - noise_nm2

    def ln_stiffness(variance_nm2: float, friction: float, exposure: float = 1.0) -> float:
        """From a blurred variance and a friction; `exposure` as a part of the true one."""
        seen_by = Camera(camera.frame_s, min(exposure * camera.exposure_s, camera.frame_s))

        def difference(ln_k: float) -> float:
            k = math.exp(ln_k)
            return math.log(float(frame_variance(energy / k, friction / k, seen_by)) / variance_nm2)

        middle = math.log(motion.stiffness)
        return float(optimize.brentq(difference, middle - 20, middle + 20))

    found = ln_stiffness(corrected_nm2, motion.friction)
    step = DERIVATIVE_STEP
    per_variance = abs(ln_stiffness(corrected_nm2 * (1 - step), motion.friction) - found) / step
    per_friction = abs(ln_stiffness(corrected_nm2, motion.friction * (1 + step)) - found) / step
    per_exposure = abs(ln_stiffness(corrected_nm2, motion.friction, 1 - step) - found) / step
    statistics = per_variance * stderr_without_noise_nm2 / corrected_nm2
    return replace(
        common_errors(plan, force_pN, axis),
        bias=math.exp(found) / motion.stiffness - 1,
        statistics=statistics,
        friction=per_friction * knowledge.friction,
        noise=math.hypot(
            left_in_quadrature(per_variance * stderr_nm2 / corrected_nm2, statistics),
            per_variance * unsure_nm2 / corrected_nm2,
        ),
        exposure=per_exposure * knowledge.exposure,
    )


def error_of_arctangent(
    plan: Plan, force_pN: float, axis: int, correction: Correction
) -> ForceError:
    """Error of the force by the scheme of te Velthuis et al. 2010."""
    camera, knowledge = plan.experiment.camera, plan.knowledge
    motion = axis_motion(plan, force_pN, axis)
    noise_nm2, unsure_nm2 = _noise(plan, axis)
    corner_hz = 1 / (2 * math.pi * motion.tau_s)
    resolved = math.ceil(BELOW_CORNER * camera.nyquist_hz / corner_hz)
    count = min(max(FEWEST_ORDINATES, resolved), plan.frames // 2)
    frequency = camera.nyquist_hz * np.arange(1, count + 1) / count
    power = expected_spectrum(frequency, plan.state(force_pN), plan.experiment, axis)

    start = (math.log(motion.variance_nm2), math.log(corner_hz))
    white = 2 * camera.frame_s

    def at_exposure(share: float) -> ExpectedArctangent | None:
        return expected_arctangent(
            frequency,
            power - white * noise_nm2,
            start,
            camera.frame_s,
            share * camera.exposure_s,
            correction,
        )

    found = at_exposure(1.0)
    shorter = at_exposure(1 - DERIVATIVE_STEP) if knowledge.exposure else found
    if found is None or shorter is None:
        return NO_FORCE
    # each ordinate here stands for several of the recording
    share = count / (plan.frames / 2)
    quiet = power - white * plan.experiment.tracker.noise_nm[axis] ** 2
    scatter, without_noise = (
        math.sqrt(share * float(found.response**2 @ p**2)) for p in (power, quiet)
    )
    per_exposure = abs(shorter.ln_variance - found.ln_variance) / DERIVATIVE_STEP
    return replace(
        common_errors(plan, force_pN, axis),
        bias=motion.variance_nm2 / math.exp(found.ln_variance) - 1,
        statistics=without_noise,
        noise=math.hypot(
            left_in_quadrature(scatter, without_noise),
            abs(float(found.response.sum())) * white * unsure_nm2,
        ),
        exposure=per_exposure * knowledge.exposure,
    )


def _noise(plan: Plan, axis: int) -> tuple[float, float]:
    """Variance of the noise that is subtracted, and its standard error, nm²."""
    factor = plan.knowledge.noise_factor
    if factor is None:
        return 0.0, 0.0
    variance = plan.experiment.tracker.noise_nm[axis] ** 2
    # half of the central 68 %, from 1/factor² to factor² times the variance
    return variance, (factor**2 - factor**-2) / 2 * variance


def _variance(plan: Plan, force_pN: float, axis: int) -> tuple[float, float, float]:
    """Recorded variance, its standard error with noise and without, nm².

    Var = ∫ S² df / T over one-sided frequencies (Isserlis 1918): for white noise 2σ⁴/N.
    """
    nyquist, frame_s = plan.experiment.camera.nyquist_hz, plan.experiment.camera.frame_s
    slowest = float(np.max(plan.state(force_pN).modes.tau_s))
    lowest = min(1e-3 / slowest, 1e-3 * nyquist)
    steps = math.ceil(math.log(nyquist / lowest) / LN_STEP)
    frequency = np.geomspace(lowest, nyquist, steps)
    power = expected_spectrum(frequency, plan.state(force_pN), plan.experiment, axis)
    white = 2 * frame_s * plan.experiment.tracker.noise_nm[axis] ** 2

    def integral(values: FloatArray) -> float:
        """From zero frequency: below the lowest a spectrum is flat."""
        return float(values[0] * lowest + np.trapezoid(values * frequency, np.log(frequency)))

    scatters = [
        math.sqrt(integral(values**2) / plan.duration_s) for values in (power, power - white)
    ]
    return integral(power), scatters[0], scatters[1]
