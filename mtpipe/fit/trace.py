"""Maximum-likelihood fit of one trace: stiffness, friction, noise, corner frequency.

The likelihood is that of the binned periodogram (Whittle, with the exact expectation for the frames
that are there); lmfit minimises its deviance. Nothing here knows of files, beads or plateaus.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from mtpipe.fit.arguments import check_arguments
from mtpipe.fit.estimates import (
    NOT_IDENTIFIED_LN,
    fitted_log_noise,
    fitted_noise,
    inverse_information,
    known_noise,
    logarithmic,
    tied,
)
from mtpipe.fit.model import COORDINATES, PRIOR_HALF_WIDTH, TraceModel
from mtpipe.fit.profile import is_parabola, profile_reach
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.shown import Shown, estimates_table
from mtpipe.ground.status import status_of
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import number
from mtpipe.physics.modes import SINGLE_MODE, Modes
from mtpipe.spectra.spectrum import Spectrum, periodogram, prewhitening

# Standard error of a ln stiffness that the data do not tell.
NOT_TOLD_LN = 2.0
# A noise below this share of the trace's variance is indistinguishable from none.
AT_ZERO = 1e-7
# Largest covariance of coordinates of order one that is believed; lmfit gives larger ones to what
# the data do not determine.
SENSIBLE_COVARIANCE = 1e6
# ln stiffness, ln friction and ln corner frequency as sums of the first two coordinates.
SHARES = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]])
FRICTION = 1
METHOD = "spectrum, maximum likelihood"
# Steps in which a valley of the deviance is followed.
VALLEY_STEPS = 4
VALLEY_ITERATIONS = 2
# Largest leakage that is accepted, over 1/√N, what N frames tell. The ends of a trace leak a share
# τ/T of the power, the same at all frequencies.
LEAKAGE = 0.1
# Prewhitening needs pairs of successive frames: not where most frames have lost their neighbour.
LEAST_PAIRS = 0.4


@dataclass(frozen=True)
class TraceFit(Shown):
    """Result of `fit_trace`.

    Attributes
    ----------
    stiffness : pN/nm. friction : pN s/nm. noise : nm. corner_frequency : Hz, k/(2πγ).
    theta, covariance : (3,) maximum of the likelihood and (3, 3) covariance in the coordinates of
        `mtpipe.fit.model`; zero rows for what was not fitted.
    deviance, dof, p_value : quality of the fit of the spectrum; p is uniform for a true model.
    """

    stiffness: Estimate
    friction: Estimate
    noise: Estimate
    corner_frequency: Estimate
    theta: FloatArray
    covariance: FloatArray
    model: TraceModel
    deviance: float
    dof: float
    p_value: float

    def __repr__(self) -> str:
        return (
            f"TraceFit: stiffness {self.stiffness}, friction {self.friction}, noise {self.noise}, "
            f"corner {self.corner_frequency}; p = {number(self.p_value, 2)}"
        )

    @property
    def table(self) -> pd.DataFrame:
        """A row for each estimate."""
        return estimates_table(self)

    @property
    def spectrum(self) -> Spectrum:
        """The binned periodogram that was fitted."""
        return self.model.spectrum

    @property
    def expected_power(self) -> FloatArray:
        """(n_bins,) nm²/Hz, what the fit expects for `spectrum.power`."""
        return np.asarray(self.model.expected(self.theta[None])[0])

    @property
    def nyquist_ratio(self) -> float:
        """Corner frequency over the Nyquist frequency."""
        return float(np.exp(self.theta[0] - self.theta[1])) / math.pi * self.spectrum.window.frame_s

    @property
    def relaxations(self) -> float:
        """Length of the trace in relaxation times."""
        return relaxations_in(self.spectrum, self.theta)

    @functools.cached_property
    def shift_per_exposure(self) -> FloatArray:
        """(3,) how far θ moves per second by which the exposure is not what it is taken for."""
        free = list(self.model.free)
        score = (self.model.slopes(self.theta) * self.model.ordinates) @ (
            self.model.exposure_slope(self.theta)
        )
        moved = np.zeros(3)
        moved[free] = -self.covariance[np.ix_(free, free)] @ score
        return moved


def fit_trace(
    x_nm: ArrayLike,
    *,
    frame_rate_hz: float,
    exposure_s: float,
    temperature_K: float,
    tracking_noise_nm: float | Literal["fit"] = 0.0,
    friction: tuple[float, float] | None = None,
    modes: Modes = SINGLE_MODE,
    lowest_hz: float = 0.0,
) -> TraceFit:
    """Fit the blurred and aliased spectrum of one trace.

    Parameters
    ----------
    x_nm : (n_frames,) positions, one per frame of the camera; NaN where a frame is lost.
    frame_rate_hz, exposure_s : of the camera; exposure at most one frame.
    temperature_K : of the buffer.
    tracking_noise_nm : standard deviation of white tracking noise if known; "fit": estimated.
    friction : prior knowledge in pN s/nm, value and standard error, or None.
    modes : relaxation modes of this axis; one unless the bead's rotation couples.
    lowest_hz : lowest frequency used.

    Returns
    -------
    TraceFit. Estimates that the trace does not determine have status "not_identified", those of a
    spectrum unlike the model's "unlike_model"; a stiffness that may be nought has "zero_force".

    Raises
    ------
    FitError : fewer than 64 frames, or no motion.
    ValueError : an exposure longer than a frame, a frame rate that no camera has, or another number
        that cannot be.
    """
    given = check_arguments(
        x_nm,
        frame_rate_hz=frame_rate_hz,
        exposure_s=exposure_s,
        temperature_K=temperature_K,
        tracking_noise_nm=tracking_noise_nm,
        friction=friction,
    )
    model = functools.partial(
        TraceModel,
        exposure_s=given.camera.exposure_s,
        thermal_energy_pN_nm=given.thermal_energy_pN_nm,
        noise_variance_nm2=given.noise_variance_nm2,
        friction=given.friction,
        modes=modes,
    )
    return fit_positions(given.x_nm, given.camera.frame_s, model, lowest_hz=lowest_hz)


def fit_positions(
    x_nm: FloatArray,
    frame_s: float,
    model: Callable[[Spectrum], TraceModel],
    *,
    lowest_hz: float = 0.0,
) -> TraceFit:
    """Fit a trace, prewhitened where power would leak between its frequencies.

    Parameters
    ----------
    x_nm : (n_frames,) positions, NaN where lost.
    model : the model of a spectrum.

    Raises
    ------
    FitError : fewer than 64 frames, or no motion.
    """
    present = np.isfinite(x_nm)
    if present.any() and not present.all():
        # frames lost at either end are no gaps
        inside = np.flatnonzero(present)
        x_nm = x_nm[inside[0] : inside[-1] + 1]
        present = np.isfinite(x_nm)
    complete = x_nm
    if present.any() and not present.all():
        frames = np.arange(len(x_nm))
        complete = np.interp(frames, frames[present], x_nm[present])
    # what leaks, and the prewhitening, ask for no more than the relaxation time of a start
    first = model(periodogram(complete, frame_s, lowest_hz=lowest_hz))
    duration_s = first.spectrum.duration_s
    tau_s = min(math.exp(first.start[1] - first.start[0]), duration_s)
    leaks = tau_s / duration_s * math.sqrt(len(x_nm)) > LEAKAGE
    if present.all() and not leaks:
        return fit_model(first)
    pairs = int(np.sum(present[1:] & present[:-1]))
    phi = prewhitening(tau_s, frame_s) if pairs > LEAST_PAIRS * present.sum() else 0.0
    return fit_model(model(periodogram(x_nm, frame_s, lowest_hz=lowest_hz, phi=phi)))


def fit_model(model: TraceModel) -> TraceFit:
    """Maximise the likelihood of a trace model with lmfit."""
    import lmfit

    start = model.start
    scale = model.spectrum.variance_nm2
    parameters = lmfit.Parameters()
    # inside the flat priors of the posterior, which is then never empty at the maximum
    reach = 0.99 * PRIOR_HALF_WIDTH
    for name, value in zip(COORDINATES[:2], start[:2], strict=True):
        parameters.add(name, value=value, min=value - reach, max=value + reach)
    # a variance in units of the trace's, so that all coordinates are of order one
    unit = 1.0 if model.noise_is_log else scale
    if model.noise_is_log:
        parameters.add(COORDINATES[2], value=start[2])
    elif model.noise_variance_nm2 is None:
        parameters.add(COORDINATES[2], value=max(start[2] / scale, 1e-4), min=0.0)

    def coordinates(values: lmfit.Parameters) -> FloatArray:
        noise = model.noise_variance_nm2
        if noise is None:
            noise = values[COORDINATES[2]].value * unit
        return np.array([values[COORDINATES[0]].value, values[COORDINATES[1]].value, noise])

    result = lmfit.minimize(
        lambda values: model.residuals(coordinates(values)[None])[0],
        parameters,
        method="leastsq",
        Dfun=lambda values: model.jacobian(coordinates(values)),
        scale_covar=False,
        ftol=1e-8,
        xtol=1e-8,
    )
    theta = coordinates(result.params)
    if not _is_bounded(model, theta):
        return describe(model, theta, inverse_information(model.information(theta)), told=False)
    if model.noise_variance_nm2 is None and not model.noise_is_log and theta[2] < AT_ZERO * scale:
        without = fit_model(replace(model, noise_variance_nm2=0.0))
        return describe(model, without.theta, inverse_information(model.information(without.theta)))
    if result.covar is None or not np.all(np.abs(result.covar) < SENSIBLE_COVARIANCE):
        return describe(model, theta, inverse_information(model.information(theta)))
    to_nm2 = np.array([1.0, 1.0, unit])[: len(model.free)]
    return describe(model, theta, result.covar * np.outer(to_nm2, to_nm2))


def _is_bounded(model: TraceModel, theta: FloatArray) -> bool:
    """Whether the deviance rises where the stiffness is a factor e away, all else adapting.

    With noise and friction both free the curvature at the maximum may look sharp while a long, flat
    valley leads away from it (PHYSICS 3.A).
    """
    if model.friction is not None or model.noise_variance_nm2 is not None or model.noise_is_log:
        return True
    lowest = float(np.sum(model.residuals(theta[None]) ** 2))
    unit = np.array([1.0, model.spectrum.variance_nm2])
    for sign in (-1.0, 1.0):
        moved = theta.copy()
        for step in np.linspace(0, NOT_IDENTIFIED_LN, VALLEY_STEPS + 1)[1:]:
            moved[0] = theta[0] + sign * step
            for _ in range(VALLEY_ITERATIONS):
                shift = 1e-4 * np.array([[0.0, unit[0], 0.0], [0.0, 0.0, unit[1]]])
                rows = model.residuals(np.vstack([moved + shift, moved]))
                jacobian = ((rows[:2] - rows[2]) / 1e-4).T
                move = np.linalg.lstsq(jacobian, rows[2], rcond=None)[0]
                moved[1] -= np.clip(move[0], -1.0, 1.0)
                moved[2] = max(moved[2] - move[1] * unit[1], 0.0)
        if float(np.sum(model.residuals(moved[None]) ** 2)) - lowest < 1.0:
            return False
    return True


def describe(
    model: TraceModel,
    theta: FloatArray,
    free_covariance: FloatArray,
    *,
    fitted: float | None = None,
    told: bool = True,
) -> TraceFit:
    """A fit's estimates from its maximum θ (3,) and the covariance of what was free.

    Parameters
    ----------
    fitted : parameters taken from this trace's data, where it shares some with others.
    told : False where the data do not tell the stiffness, whatever the covariance.
    """
    covariance = np.zeros((3, 3))
    covariance[np.ix_(model.free, model.free)] = free_covariance
    if not told:
        # along the valley k² ~ γ: the level of the spectrum, 4kTγ/k², is what the data tell
        covariance[:2, :2] += NOT_TOLD_LN**2 * np.array([[1.0, 2.0], [2.0, 4.0]])
    signed = model.residuals(theta[None])[0][: len(model.spectrum.power)]
    deviance = float(np.sum(signed**2))
    dof, p_value = model.p_value(deviance, len(model.free) if fitted is None else fitted)
    together = tied(covariance, model.free)
    parabola = fitted is not None or not told or is_parabola(model, theta, free_covariance)

    reach = None if parabola else profile_reach(model, theta, SHARES)

    returns = relaxations_in(model.spectrum, theta)

    def estimate(number: int, less: float, unit: str) -> Estimate:
        weights = np.array([*SHARES[number], 0.0])
        found = logarithmic(
            float(weights @ theta) - less,
            float(weights @ covariance @ weights),
            unit,
            METHOD,
            tied_to=together,
            reach=None if reach is None else reach[number],
        )
        # how fast a bead diffuses is known without its return
        length = math.inf if number == FRICTION else returns
        return replace(found, status=status_of(found, p_value=p_value, relaxations=length))

    return TraceFit(
        stiffness=estimate(0, 0.0, "pN/nm"),
        friction=estimate(FRICTION, 0.0, "pN s/nm"),
        noise=_noise(model, theta[2], covariance[2, 2]),
        corner_frequency=estimate(2, math.log(2 * math.pi), "Hz"),
        theta=theta,
        covariance=covariance,
        model=model,
        deviance=deviance,
        dof=dof,
        p_value=p_value,
    )


def relaxations_in(spectrum: Spectrum, theta: FloatArray) -> float:
    """Length of a trace in the relaxation times of θ (3,)."""
    return spectrum.duration_s * math.exp(theta[0] - theta[1])


def _noise(model: TraceModel, coordinate: float, variance_of_it: float) -> Estimate:
    stderr = math.sqrt(max(variance_of_it, 0.0))
    if model.noise_is_log:
        return fitted_log_noise(coordinate, stderr, METHOD)
    if model.noise_variance_nm2 is not None:
        return known_noise(model.noise_variance_nm2, METHOD)
    zero_nm2 = AT_ZERO * model.spectrum.variance_nm2
    return fitted_noise(coordinate, stderr, METHOD, zero_nm2=zero_nm2)
