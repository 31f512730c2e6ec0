"""What the arctangent scheme of te Velthuis et al. 2010 makes of a spectrum that is expected.

`mtpipe.methods.integrated_spectrum` repeats correction and fit until they agree. Where they agree
is the root of two equations, found here at once; whether the rounds get there, and how many they
take, follows from how much a round leaves of a deviation. A test compares the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from mtpipe.ground.types import FloatArray
from mtpipe.methods.integrated_spectrum import AT_REST_LN, MOST_ROUNDS, Correction

# A root that is there takes some 20 calls.
MOST_CALLS = 80
ROOT_LN = 1e-8


@dataclass(frozen=True, eq=False)
class ExpectedArctangent:
    """Result of `expected_arctangent`.

    Attributes
    ----------
    ln_variance : of the motion, nm².
    response : (n,) change of ln_variance per change of the power at each frequency.
    """

    ln_variance: float
    response: FloatArray


def expected_arctangent(
    frequency_hz: FloatArray,
    power: FloatArray,
    start: tuple[float, float],
    frame_s: float,
    exposure_s: float,
    correction: Correction,
) -> ExpectedArctangent | None:
    """Where correction and arctangent fit of an expected spectrum come to rest.

    Parameters
    ----------
    frequency_hz : (n,) equally spaced, from one spacing up to Nyquist.
    power : (n,) one-sided, nm²/Hz, tracking noise subtracted.
    start : where the scheme with aliases is sought: ln variance and ln corner frequency, roughly.

    Returns
    -------
    None where the rounds do not come to rest.
    """
    spacing = frequency_hz[0]
    gain = correction.gain(frequency_hz, exposure_s)

    def aliased(fit: FloatArray) -> FloatArray:
        return correction.aliased(frequency_hz, fit, frame_s, exposure_s)

    def pull(fit: FloatArray) -> FloatArray:
        integral = np.cumsum((power - aliased(fit)) / gain) * spacing
        model, slope = _integral(frequency_hz, fit)
        return np.asarray(slope.T @ (model - integral) / integral[-1] ** 2)

    if not correction.aliases:
        integral = np.cumsum(power / gain) * spacing
        half = int(np.argmax(integral > integral[-1] / 2))
        start = (math.log(integral[-1]), math.log(frequency_hz[half]))
    options = {"xtol": ROOT_LN, "maxfev": MOST_CALLS}
    # scipy-stubs 1.18 misspells the option maxfev
    found = optimize.root(pull, np.array(start), options=options)  # type: ignore[call-overload]
    if not found.success:
        return None
    _, slope = _integral(frequency_hz, found.x)
    projection = np.linalg.pinv(slope)
    to_power = spacing * np.cumsum(projection[:, ::-1], axis=1)[:, ::-1] / gain
    steps = 1e-5 * np.eye(2)
    per_fit = np.column_stack([(aliased(found.x + s) - aliased(found.x - s)) / 2e-5 for s in steps])
    left = to_power @ per_fit
    remains = float(np.max(np.abs(np.linalg.eigvals(left))))
    if remains >= 1 or remains**MOST_ROUNDS > AT_REST_LN:
        return None
    response = np.linalg.solve(np.eye(2) + left, to_power)
    return ExpectedArctangent(float(found.x[0]), response[0])


def _integral(frequency_hz: FloatArray, fit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Integral of the Lorentzian (ln s², ln fc) from half a spacing up, and (n, 2) derivatives."""
    variance, corner = np.exp(fit)
    low, high = frequency_hz[0] / 2, frequency_hz + frequency_hz[0] / 2
    scale = 2 * variance / math.pi
    model = scale * (np.arctan(high / corner) - np.arctan(low / corner))
    turn = scale * corner * (low / (corner**2 + low**2) - high / (corner**2 + high**2))
    return model, np.column_stack([model, turn])
