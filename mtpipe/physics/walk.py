"""A random walk, seen once a frame."""

from __future__ import annotations

import numpy as np

from mtpipe.ground.types import FloatArray


def walk_variance_s(frequency_hz: FloatArray, frame_s: float) -> FloatArray:
    """Variance per frame, at each frequency, of a random walk of 1 nm²/s: Δ/(4 sin²(π f Δ)).

    White noise of variance σ² has σ² at all of them. Its steps from frame to frame are white with a
    variance of Δ, and are the walk times |1 − exp(2πi f Δ)|² (PHYSICS E7).

    Parameters
    ----------
    frequency_hz : above 0. frame_s : Δ, the time between frames.
    """
    return np.asarray(frame_s / (2 * np.sin(np.pi * frequency_hz * frame_s)) ** 2)
