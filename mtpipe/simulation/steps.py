"""How a camera's frame divides into time steps.

For simulators that move in small steps. A frame is a whole number of equal steps; the exposure, at
the start of the frame, is the nearest whole number of them and at least one: an exposure of zero is
one instantaneous position. What the camera records is the plain mean of the positions at the
exposed steps; for n of them it differs from the integral by about 1/n² of the blur.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtpipe.physics.camera import Camera


@dataclass(frozen=True)
class FrameSteps:
    """The steps of a frame: how many, how many of them exposed, and how long each."""

    per_frame: int
    exposed: int
    time_step_s: float

    @property
    def exposure_s(self) -> float:
        """The exposure that is simulated; off the camera's by half a step at most."""
        return self.exposed * self.time_step_s


def divide_frame(camera: Camera, longest_step_s: float) -> FrameSteps:
    """The frame in equal steps no longer than asked for.

    Up to 10 % more steps than needed are taken where that makes the exposure a whole number of them
    (or comes closer to it).

    Raises
    ------
    ValueError : the step is not positive.
    """
    if not longest_step_s > 0:
        raise ValueError(f"time step {longest_step_s} s: must be positive")
    fewest = max(math.ceil(camera.frame_s / longest_step_s - 1e-9), 1)
    candidates = np.arange(fewest, fewest + fewest // 10 + 1)
    exposed = candidates * min(camera.exposure_s / camera.frame_s, 1.0)
    best = int(np.argmin(np.round(np.abs(exposed - np.round(exposed)) / candidates, 9)))
    per_frame = int(candidates[best])
    return FrameSteps(per_frame, max(round(exposed[best]), 1), camera.frame_s / per_frame)
