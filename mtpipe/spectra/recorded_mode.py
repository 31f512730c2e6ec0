"""`physics.camera.recorded_parts` of one mode at a time, compiled: fits ask for little but this.

Importing this module imports numba.
"""

from __future__ import annotations

import math

import numpy as np

from mtpipe.ground.compiled import compiled
from mtpipe.ground.types import FloatArray

# Modes that relax within a smaller share of a frame are as white as this one.
SHORTEST = 1e-9
# Below this ratio of exposure to relaxation time the closed form of the blur cancels.
SHORT_BLUR = 0.1
# Coefficients of `physics.camera.white_deficit`, of α, α³, α⁵, …
DEFICIT = np.array([2 / math.factorial(2 * j + 3) for j in range(10)])


@compiled
def seen_mode(
    tau_s: float, longest_s: float, frame_s: float, exposure_s: float
) -> tuple[float, float, float]:
    """Relaxation time over D, white and correlated part of a mode of unit variance.

    Of what is slower than a segment only the variance over τ is seen.

    Parameters
    ----------
    longest_s : relaxation time beyond which a mode is no more than a trend.
    frame_s, exposure_s : of the camera.
    """
    tau = min(max(tau_s, SHORTEST * frame_s), longest_s)
    seen = longest_s / tau_s if tau_s > longest_s else 1.0
    alpha = exposure_s / tau
    if tau >= frame_s:
        square, series = alpha * alpha, 0.0
        for j in range(len(DEFICIT) - 1, -1, -1):
            series = series * square + DEFICIT[j]
        gain = math.sinh(alpha / 2) / (alpha / 2) if alpha > 0 else 1.0
        return tau / frame_s, -seen * alpha * series, seen * gain * gain
    gone = -math.expm1(-alpha)
    if alpha < SHORT_BLUR:
        blur = 1.0
        for j in range(8, 2, -1):
            blur = 1 - alpha / j * blur
    else:
        blur = 2 * (alpha - gone) / alpha**2
    edge = gone / alpha if alpha > 0 else 1.0
    dead = math.exp(-(frame_s - exposure_s) / tau)
    return tau / frame_s, seen * blur, seen * edge * edge * dead


@compiled
def seen_modes_of(
    tau_s: FloatArray, longest_s: FloatArray, frame_s: float, exposure_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n,) of each that `seen_mode` gives, for (n,) relaxation times and longest ones."""
    tau, white, correlated = np.empty_like(tau_s), np.empty_like(tau_s), np.empty_like(tau_s)
    for i in range(len(tau_s)):
        tau[i], white[i], correlated[i] = seen_mode(tau_s[i], longest_s[i], frame_s, exposure_s)
    return tau, white, correlated
