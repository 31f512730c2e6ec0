"""How a camera's frame divides into time steps, and the camera emulated on a path of such steps.

For simulators that move in small steps. A frame is a whole number of equal steps; the exposure, at
the start of the frame, is the nearest whole number of them and at least one: an exposure of zero is
one instantaneous position. What the camera records is the plain mean of the positions at the
exposed steps; for n of them it differs from the integral by about 1/n² of the blur.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.types import FloatArray
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


def emulate_camera(
    path_nm: NDArray[np.float64], steps_per_frame: int, steps_exposed: int
) -> FloatArray:
    """Recorded positions of a path given step by step.

    Parameters
    ----------
    path_nm : (steps, ...) positions; steps after the last complete frame are left out.
    steps_per_frame, steps_exposed : the frame, and the exposure at its start.

    Returns
    -------
    (frames, ...) means over each exposure.

    Raises
    ------
    ValueError : the exposure is not between one step and the frame.
    """
    if not 1 <= steps_exposed <= steps_per_frame:
        raise ValueError(
            f"{steps_exposed} steps exposed of {steps_per_frame} per frame: at least one, at most "
            "all are possible"
        )
    frames = len(path_nm) // steps_per_frame
    split = path_nm[: frames * steps_per_frame].reshape(frames, steps_per_frame, *path_nm.shape[1:])
    return np.asarray(split[:, :steps_exposed].mean(axis=1))
