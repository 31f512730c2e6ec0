"""What the paper's scheme and the exact fit make of an expected spectrum, or of a trace.

On the *expected* spectrum a method shows its bias and nothing else; its scatter for traces of N
frames is known to first order (the ordinates of a periodogram scatter by their expectation). The
exact fit has no bias there; its scatter is the Cramér–Rao bound. All in shares of the truth, all
functions of the corner frequency over the Nyquist frequency alone, since W = 1/f_s throughout.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from quoted import LIMIT_ERROR
from scipy import optimize
from setting import Bead

import mtpipe
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.methods.integrated_spectrum import Correction, fit_spectrum
from mtpipe.physics.camera import Camera, power_spectrum

CORRECTIONS = {
    "arctangent-uncorrected": Correction(False, ()),
    "arctangent-blur-only": Correction(True, ()),
    "arctangent-one-alias": Correction(True, (-1,)),
    "arctangent": Correction(True, (-1, 1)),
}
EXACT = "exact fit"
METHODS = (*CORRECTIONS, EXACT)
QUANTITIES = ("force", "corner", "radius")
# A unit of time in which the Nyquist frequency is 1.
UNIT_CAMERA = Camera(0.5, 0.5)
ORDINATES = 1024
# The paper's own corner frequencies end below Nyquist; beyond this nobody would try.
LARGEST_RATIO = 8.0
SCAN = np.geomspace(0.02, LARGEST_RATIO, 49)


@dataclass(frozen=True)
class Recovered:
    """Relative deviations (force, corner frequency, radius) and their scatter × √N; NaN: no fit."""

    bias: FloatArray
    scatter: FloatArray

    def rms(self, frames: int) -> FloatArray:
        """Root-mean-square error for traces of so many frames."""
        return np.asarray(np.sqrt(self.bias**2 + self.scatter**2 / frames))


@functools.cache
def expected(method: str, ratio: float) -> Recovered:
    """A method on the expected spectrum at a corner frequency in units of the Nyquist frequency."""
    frequency = np.arange(1, ORDINATES) / ORDINATES
    # (ln s², ln fc) → ln of force, corner frequency, radius; γ ∝ 1/(s² fc)
    to_quantities = np.array([[-1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
    if method == EXACT:
        covariance = _bound(frequency, ratio)
        truth = np.zeros(2)
    else:
        power = power_spectrum(frequency, 1.0, 1 / (2 * np.pi * ratio), UNIT_CAMERA)
        fit = fit_spectrum(
            frequency, power, UNIT_CAMERA.frame_s, UNIT_CAMERA.exposure_s, CORRECTIONS[method]
        )
        if fit is None or not fit.converged:
            return Recovered(np.full(3, np.nan), np.full(3, np.nan))
        truth = fit.fit - np.array([0.0, math.log(ratio)])
        # so many ordinates are those of a trace twice as long in frames
        covariance = fit.covariance * 2 * ORDINATES
    variance = np.diag(to_quantities @ covariance @ to_quantities.T)
    shares = np.exp(to_quantities @ truth)
    return Recovered(shares - 1, shares * np.sqrt(variance))


def limit(error: Callable[[float], float]) -> tuple[float, str]:
    """The corner frequency over Nyquist up to which an error stays below 10 %, and why no further.

    Scans upwards and stops at the first crossing; where there is no fit any more, it ends as well.
    """
    before = SCAN[0]
    for ratio in SCAN:
        end = ratio if np.isfinite(error(float(ratio))) else _last_fit(error, before, ratio)
        if abs(error(float(end))) > LIMIT_ERROR:
            if ratio == before:
                return float(ratio), "below"
            crossing = optimize.brentq(
                lambda at: abs(error(at)) - LIMIT_ERROR, before, end, xtol=1e-4
            )
            return float(crossing), ""
        if end < ratio:
            return float(end), "no fit beyond"
        before = ratio
    return math.inf, ""


def _last_fit(error: Callable[[float], float], there: float, lost: float) -> float:
    """The largest ratio with a fit between one with and one without, to 0.1 %."""
    while lost / there > 1.001:
        middle = math.sqrt(there * lost)
        there, lost = (middle, lost) if np.isfinite(error(middle)) else (there, middle)
    return there


def bias_limit(method: str, quantity: str = "force") -> float:
    """Largest corner frequency over Nyquist with a bias below 10 %."""
    index = QUANTITIES.index(quantity)
    return limit(lambda ratio: float(expected(method, ratio).bias[index]))[0]


def rms_limit(method: str, frames: int, *, above: float = 0.0) -> float:
    """Largest corner frequency over Nyquist with a root-mean-square error of force below 10 %.

    Parameters
    ----------
    above : slower motion is not looked at; there it is the length of the trace that limits.
    """

    def error(ratio: float) -> float:
        return float(expected(method, ratio).rms(frames)[0]) if ratio >= above else 0.0

    return limit(error)[0]


def recover(method: str, x_nm: FloatArray, bead: Bead) -> FloatArray:
    """(3,) relative deviations of force, corner frequency, radius from a trace; NaN: no fit."""
    setting = bead.setting
    arguments = {
        "frame_rate_hz": setting.frame_rate_hz,
        "exposure_s": setting.camera.exposure_s,
        "temperature_K": setting.temperature_K,
    }
    try:
        if method == EXACT:
            fit = mtpipe.fit_trace(x_nm, **arguments)
        else:
            fit = mtpipe.fit_by_method(method, x_nm, **arguments)
    except FitError:
        return np.full(3, np.nan)
    truth = np.array([bead.stiffness[0], bead.corner_hz[0], setting.friction])
    found = np.array([fit.stiffness.value, fit.corner_frequency.value, fit.friction.value])
    return np.asarray(found / truth - 1)


def _bound(frequency: FloatArray, ratio: float) -> FloatArray:
    """(2, 2) Cramér–Rao bound of (ln s², ln fc) × frames, from the exact spectrum."""

    def ln_power(ln_values: FloatArray) -> FloatArray:
        variance, corner = np.exp(ln_values)
        power = power_spectrum(frequency, variance, 1 / (2 * np.pi * corner), UNIT_CAMERA)
        return np.asarray(np.log(power))

    at, step = np.array([0.0, math.log(ratio)]), 1e-4
    slope = np.array([(ln_power(at + s) - ln_power(at - s)) / 2e-4 for s in step * np.eye(2)])
    return np.linalg.inv(slope @ slope.T) * 2 * ORDINATES
