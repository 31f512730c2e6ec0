"""The scheme of te Velthuis et al. 2010: corrected spectrum, integrated, fitted with an arctangent.

The measured spectrum is freed of the first alias orders and divided by the blur of the exposure
(their Eqs 16–19); aliases come from the fit itself, so correction and fit are repeated until they
agree. The integral of the result is fitted by plain least squares with (2s²/π) arctan(f/fc) (Eqs 10
and 11), which gives variance and corner frequency, hence stiffness and friction.

This follows the paper and keeps its biases: higher aliases are left out, white tracking noise is
none of its parameters, and the friction is always fitted. For the spectrum expected with W = D, the
stiffness is 1.1 % low at a corner frequency at Nyquist and 6.4 % low at twice that. Spectra are
one-sided, per Hz. Standard errors follow from those of the periodogram's ordinates through the fit
and through the correction; they know nothing of the bias.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft

from mtpipe.fit.arguments import TraceArguments
from mtpipe.fit.estimates import known_noise
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.methods.result import MethodFit, describe, without_values

MOST_ROUNDS = 200
# One fit takes some 20 calls; where the corner lies far above Nyquist it would never end.
MOST_CALLS = 200
AT_REST_LN = 1e-5
# A correction that has moved the fit by this factor from where it began has run away.
RUN_AWAY_LN = 5.0
# Single lost frames are bridged by straight lines; the error is far below the statistical one.
MOST_LOST_SHARE = 0.01


@dataclass(frozen=True)
class Correction:
    """What the camera is taken to do: blur or not, and which alias orders."""

    blur: bool
    aliases: tuple[int, ...]

    def gain(self, frequency_hz: FloatArray, exposure_s: float) -> FloatArray:
        """sinc² of the exposure (Eq 17), or 1."""
        if not self.blur:
            return np.ones_like(frequency_hz)
        return np.asarray(np.sinc(frequency_hz * exposure_s) ** 2)

    def aliased(
        self, frequency_hz: FloatArray, fit: FloatArray, frame_s: float, exposure_s: float
    ) -> FloatArray:
        """Power that comes from the neighbouring orders (Eq 18), in nm²/Hz."""
        power = np.zeros_like(frequency_hz)
        for order in self.aliases:
            shifted = frequency_hz + order / frame_s
            power += self.gain(shifted, exposure_s) * lorentzian(shifted, fit)
        return power


# With blur and the aliases of both first orders, as published, and with neither.
CORRECTED, UNCORRECTED = Correction(True, (-1, 1)), Correction(False, ())


@dataclass(frozen=True)
class ArctangentFit:
    """Result of `fit_spectrum`: (ln s², ln fc), its covariance, and how the rounds ended."""

    fit: FloatArray
    covariance: FloatArray
    rounds: int
    converged: bool


def fit_arctangent(method: str, arguments: TraceArguments, correction: Correction) -> MethodFit:
    """The scheme on one trace.

    Raises
    ------
    FitError : more than 1 % of the frames are lost: the scheme needs a complete trace.
    """
    notes = []
    x = arguments.x_nm
    present = np.isfinite(x)
    lost = int(np.sum(~present))
    if lost > MOST_LOST_SHARE * len(x):
        raise FitError(
            f"{lost} of {len(x)} frames are lost and the arctangent method needs a complete trace",
            mend='Use a method that knows gaps, such as "allan".',
        )
    if lost:
        time = np.arange(len(x))
        x = np.interp(time, time[present], x[present])
        notes.append(f"{lost} lost frames were bridged by straight lines.")
    if arguments.friction is not None:
        notes.append("The given friction was not used: this method always fits it.")
    noise_nm2 = arguments.noise_variance_nm2
    if noise_nm2 is None:
        noise_nm2 = 0.0
        notes.append("The tracking noise was taken as zero: this method cannot fit it.")
    frame_s = arguments.camera.frame_s
    power = 2 * frame_s / len(x) * np.abs(fft.rfft(x - x.mean())) ** 2
    used = slice(1, (len(x) + 1) // 2)
    frequency = np.arange(len(power))[used] / (len(x) * frame_s)
    result = fit_spectrum(
        frequency,
        power[used] - 2 * frame_s * noise_nm2,
        frame_s,
        arguments.camera.exposure_s,
        correction,
        noise_power=2 * frame_s * noise_nm2,
    )
    if result is None:
        notes.append("No arctangent fits the integral of the corrected spectrum.")
        return without_values(method, tuple(notes))
    if not result.converged:
        notes.append(f"The alias correction did not converge in {result.rounds} rounds.")
    to_stiffness = np.array([[-1.0, 0.0], [-1.0, -1.0]])
    ln_values = to_stiffness @ result.fit
    ln_values += math.log(arguments.thermal_energy_pN_nm)
    ln_values[1] -= math.log(2 * math.pi)
    return describe(
        method,
        ln_values,
        to_stiffness @ result.covariance @ to_stiffness.T,
        known_noise(noise_nm2, method),
        duration_s=len(x) * frame_s,
        converged=result.converged,
        notes=tuple(notes),
    )


def fit_spectrum(
    frequency_hz: FloatArray,
    power: FloatArray,
    frame_s: float,
    exposure_s: float,
    correction: Correction,
    *,
    noise_power: float = 0.0,
) -> ArctangentFit | None:
    """Corrections and arctangent fit in turn until they agree.

    Parameters
    ----------
    frequency_hz : (n,) equally spaced, from one spacing up to Nyquist.
    power : (n,) one-sided spectrum in nm²/Hz, tracking noise subtracted.
    noise_power : what was subtracted; it still scatters.

    Returns
    -------
    The fit, or None where no arctangent fits: no positive integral, or no corner in sight.
    """
    gain = correction.gain(frequency_hz, exposure_s)

    def aliased(fit: FloatArray) -> FloatArray:
        return correction.aliased(frequency_hz, fit, frame_s, exposure_s)

    if not np.sum(power / gain) > 0:
        return None
    fit, found = _fit_integral(frequency_hz, power / gain, None)
    nyquist = 0.5 / frame_s
    if correction.aliases and (not found or fit[1] > math.log(nyquist)):
        # without aliases taken off a flat spectrum has no corner: begin with it at Nyquist, where
        # half of the Lorentzian's integral has been reached
        fit = np.log([2 * np.sum(power / gain) * frequency_hz[0], nyquist])
    elif not found:
        return None
    first, rounds, converged = fit, 1, not correction.aliases
    while not converged and rounds < MOST_ROUNDS:
        before = fit
        fit, found = _fit_integral(frequency_hz, (power - aliased(before)) / gain, before)
        rounds += 1
        if not found or np.max(np.abs(fit - first)) > RUN_AWAY_LN:
            break
        converged = bool(np.max(np.abs(fit - before)) < AT_REST_LN)
    # small changes of ordinates and of the aliases' parameters, carried through the fit
    spacing = frequency_hz[0]
    slope = _slope(lambda values: _arctangent(frequency_hz, values), fit)
    projection = np.linalg.pinv(slope)
    to_power = spacing * np.cumsum(projection[:, ::-1], axis=1)[:, ::-1] / gain
    feedback = np.eye(2) + to_power @ _slope(aliased, fit)
    response = np.linalg.pinv(feedback) @ to_power
    scatter = gain * lorentzian(frequency_hz, fit) + aliased(fit) + noise_power
    return ArctangentFit(fit, (response * scatter**2) @ response.T, rounds, converged)


def lorentzian(frequency_hz: FloatArray, fit: FloatArray) -> FloatArray:
    """One-sided spectrum of the motion itself (Eq 10), nm²/Hz, for (ln s², ln fc)."""
    variance, corner = np.exp(fit)
    return np.asarray(2 * variance * corner / (np.pi * (corner**2 + frequency_hz**2)))


def _arctangent(frequency_hz: FloatArray, fit: FloatArray) -> FloatArray:
    """Integral of the Lorentzian over the ordinates' bins, from half a spacing upwards, nm²."""
    half = frequency_hz[0] / 2
    variance, corner = np.exp(fit)
    rise = np.arctan((frequency_hz + half) / corner) - np.arctan(half / corner)
    return np.asarray(2 * variance / np.pi * rise)


def _slope(of: Callable[[FloatArray], FloatArray], fit: FloatArray) -> FloatArray:
    """(n, 2) derivatives by ln s² and ln fc."""
    steps = 1e-5 * np.eye(2)
    return np.column_stack([(of(fit + step) - of(fit - step)) / 2e-5 for step in steps])


def _fit_integral(
    frequency_hz: FloatArray, corrected: FloatArray, start: FloatArray | None
) -> tuple[FloatArray, bool]:
    """Least-squares (ln s², ln fc) of the integrated spectrum, and whether there is one."""
    import lmfit

    integral = np.cumsum(corrected) * frequency_hz[0]
    total = float(integral[-1])
    if start is None:
        # half of the integral is reached at the corner if the whole Lorentzian is seen
        start = np.log([total, frequency_hz[int(np.argmax(integral > total / 2))]])
    if not total > 0:
        return start, False
    parameters = lmfit.Parameters()
    for name, value in zip(("ln_variance", "ln_corner"), start, strict=True):
        parameters.add(name, value, min=value - 20, max=value + 20)

    def coordinates(values: lmfit.Parameters) -> FloatArray:
        return np.array([values["ln_variance"].value, values["ln_corner"].value])

    result = lmfit.minimize(
        lambda values: (_arctangent(frequency_hz, coordinates(values)) - integral) / total,
        parameters,
        method="leastsq",
        calc_covar=False,
        max_nfev=MOST_CALLS,
        ftol=1e-12,
        xtol=1e-10,
    )
    return coordinates(result.params), bool(result.success)
