"""What a caller says about one trace, checked: shared by all fits of a single trace.

Impossible numbers are refused here, each by its name, before anything is computed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mtpipe.ground.types import FloatArray
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera

# The motion is taken to be overdamped: a bead of 1 µm forgets its velocity within 0.1 µs, one of
# 2.8 µm within 1 µs, and a million frames a second is what the fastest cameras reach. At the other
# end, beads of any use return within seconds, and 64 frames at 0.1 Hz take more than ten minutes,
# in which microscopes drift by more than a bead moves.
FRAME_RATES_HZ = (0.1, 1e6)


@dataclass(frozen=True)
class TraceArguments:
    """One trace and what is known about it.

    Attributes
    ----------
    x_nm : (n_frames,) positions; NaN where a frame is lost.
    camera : frame interval and exposure, the exposure at most one frame.
    thermal_energy_pN_nm : of the buffer.
    noise_variance_nm2 : known white tracking noise, or None where it is to be fitted.
    friction : prior value and standard error in pN s/nm, or None.
    """

    x_nm: FloatArray
    camera: Camera
    thermal_energy_pN_nm: float
    noise_variance_nm2: float | None
    friction: tuple[float, float] | None


def check_arguments(
    x_nm: ArrayLike,
    *,
    frame_rate_hz: float,
    exposure_s: float,
    temperature_K: float,
    tracking_noise_nm: float | Literal["fit"],
    friction: tuple[float, float] | None,
) -> TraceArguments:
    """Check the arguments of `fit_trace` and `fit_by_method`; their docstrings say what they are.

    Raises
    ------
    ValueError : more than one trace, an exposure longer than a frame, or a number that cannot be.
    """
    x = np.asarray(x_nm, dtype=float)
    if x.ndim != 1:
        raise ValueError(f"x_nm must be one trace, (n_frames,), got the shape {x.shape}")
    low, high = FRAME_RATES_HZ
    if not low <= frame_rate_hz <= high:
        raise ValueError(
            f"frame_rate_hz = {frame_rate_hz:g} is no camera's that follows a tethered bead "
            f"({low:g} to {high:g} frames/s)"
        )
    if not 250 < temperature_K < 400:
        raise ValueError(f"temperature_K = {temperature_K} is no temperature of a buffer in K")
    frame_s = 1 / frame_rate_hz
    # a written exposure may exceed the frame by rounding, which `Camera` forgives
    camera = Camera(frame_s, min(Camera(frame_s, exposure_s).exposure_s, frame_s))
    known: float | None
    if isinstance(tracking_noise_nm, str):
        if tracking_noise_nm != "fit":
            raise ValueError(f'tracking_noise_nm is a number or "fit", got {tracking_noise_nm!r}')
        known = None
    elif not (math.isfinite(tracking_noise_nm) and tracking_noise_nm >= 0):
        raise ValueError(f"tracking_noise_nm must be at least 0, got {tracking_noise_nm}")
    else:
        known = tracking_noise_nm**2
    _check_friction(friction)
    return TraceArguments(x, camera, float(thermal_energy_pN_nm(temperature_K)), known, friction)


def _check_friction(friction: Any) -> None:
    """None, or two positive numbers."""
    if friction is None:
        return
    try:
        value, stderr = friction
        sound = value > 0 and stderr > 0
    except (TypeError, ValueError):
        sound = False
    if not sound:
        raise ValueError(
            "friction is a positive value and its standard error in pN s/nm, as in "
            f"(2.3e-5, 0.7e-6), or None; got {friction!r}"
        )
