"""Other ways to read the paper's recipe, each on the expected spectrum: what would they give?

A `Reading` says what is corrected, what is fitted to what, and which number is called the force.
Everything the text leaves open is a knob here; nothing is taken from the paper's own programs,
which are not public. A Matlab script handed on by the same laboratory (Hensgens, Lipfert & Yu 2014,
`spectral_analysis` in github.com/svandersmagt/BEP-new-GIT, "in the manner described by te Velthuis
et al.") is: integral and arctangent, blur and n = ±1, repeated until force and radius change by
less than 0.01 pN and 0.01 µm; its window and its stopping rule are readings too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from mtpipe.ground.types import FloatArray
from mtpipe.methods.integrated_spectrum import Correction, lorentzian
from mtpipe.physics.camera import Camera, power_spectrum

ORDINATES = 512
MOST_ROUNDS = 100
RUN_AWAY_LN = 5.0


@dataclass(frozen=True)
class Reading:
    """One way to read the recipe; frequencies in units of the Nyquist frequency, kT/k = 1.

    Attributes
    ----------
    fit : "integral" (the paper's), "log integral", "spectrum", "log spectrum", "friction known",
        "variance summed": least squares of what, and with what given.
    number : "variance" (F = kT L/s², the paper's Eq 8), "corner" (F = 2π fc γ L with the nominal
        γ), "rms amplitude", "inverse": what is said to be off by 10 %.
    upto : largest frequency that is fitted.
    rounds : how often aliases are computed anew; None: until nothing changes.
    at_rest_ln : changes of ln s² and ln fc that count as nothing.
    raw_start : whether the first aliases are those of the fit to the spectrum as measured, or to
        the one corrected for blur.
    alias_share : of the aliases that is taken off.
    exposure : of a frame.
    noise : white noise, ε over the standard deviation of the motion, as a function of the corner.
    """

    fit: str = "integral"
    number: str = "variance"
    upto: float = 1.0
    rounds: int | None = None
    at_rest_ln: float = 1e-5
    raw_start: bool = False
    alias_share: float = 1.0
    exposure: float = 1.0
    assumed_exposure: float | None = None
    noise: Callable[[float], float] | None = None


def error(reading: Reading, correction: Correction, ratio: float) -> float:
    """Relative error of the number called force at a corner frequency; NaN where nothing fits."""
    frame = 0.5
    true_exposure = reading.exposure * frame
    exposure = true_exposure
    if reading.assumed_exposure is not None:
        exposure = reading.assumed_exposure * frame
    frequency = np.arange(1, ORDINATES) / ORDINATES
    power = power_spectrum(frequency, 1.0, 1 / (2 * np.pi * ratio), Camera(frame, true_exposure))
    if reading.noise is not None:
        power = power + 2 * frame * reading.noise(ratio) ** 2
    gain = correction.gain(frequency, exposure)
    raw = reading.raw_start and correction.aliases
    fit = _fit(reading, frequency, power if raw else power / gain, ratio, None)
    truth = np.array([0.0, np.log(ratio)])
    rounds = MOST_ROUNDS if reading.rounds is None else reading.rounds
    at_rest = not correction.aliases
    for _ in range(rounds if correction.aliases else 0):
        if not np.all(np.abs(fit - truth) < RUN_AWAY_LN):
            return np.nan
        aliased = reading.alias_share * correction.aliased(frequency, fit, frame, exposure)
        before = fit
        fit = _fit(reading, frequency, (power - aliased) / gain, ratio, before)
        if np.max(np.abs(fit - before)) < reading.at_rest_ln:
            at_rest = True
            break
    if not at_rest and reading.rounds is None:
        return np.nan
    if not np.all(np.abs(fit - truth) < RUN_AWAY_LN):
        return np.nan
    variance, corner = np.exp(fit)
    numbers = {
        "variance": 1 / variance,
        "corner": corner / ratio,
        "rms amplitude": np.sqrt(variance),
        "inverse": variance,
    }
    return float(numbers[reading.number] - 1)


def _fit(
    reading: Reading,
    frequency: FloatArray,
    power: FloatArray,
    ratio: float,
    start: FloatArray | None,
) -> FloatArray:
    """(ln s², ln fc) by least squares."""
    used = frequency <= reading.upto
    f, seen = frequency[used], power[used]
    spacing = frequency[0]
    integral = np.cumsum(seen) * spacing
    edge = f + spacing / 2

    def arctangent(fit: FloatArray) -> FloatArray:
        variance, corner = np.exp(fit)
        rise = np.arctan(edge / corner) - np.arctan(spacing / 2 / corner)
        return np.asarray(2 * variance / np.pi * rise)

    shapes: dict[str, Callable[[FloatArray], FloatArray]] = {
        "integral": lambda fit: (arctangent(fit) - integral) / integral[-1],
        "log integral": lambda fit: np.log(arctangent(fit) / np.maximum(integral, 1e-9)),
        "spectrum": lambda fit: (lorentzian(f, fit) - seen) / seen[0],
        "log spectrum": lambda fit: np.log(lorentzian(f, fit) / np.maximum(seen, 1e-9)),
    }
    ln_corner = np.log(ratio)
    if reading.fit == "friction known":
        # γ ∝ 1/(s² fc) at its true value
        residuals, full = shapes["integral"], lambda p: np.array([ln_corner - p[0], p[0]])
        first = np.array([ln_corner])
    elif reading.fit == "variance summed":
        summed = np.log(np.sum(power) * spacing)
        residuals, full = shapes["integral"], lambda p: np.array([summed, p[0]])
        first = np.array([ln_corner])
    else:
        residuals, full = shapes[reading.fit], lambda p: p
        first = np.array([0.0, ln_corner]) if start is None else start
    result = optimize.least_squares(
        lambda p: residuals(full(p)), first, bounds=(-12.0, 12.0), xtol=1e-11, ftol=1e-11
    )
    return np.asarray(full(result.x))
