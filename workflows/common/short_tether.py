"""A setup that needs nothing else: 1 µm beads on short tethers, with a reference bead."""

from __future__ import annotations


def short_tether(frame_rate_hz: float, exposure_s: float, *, viscosity_mPa_s: float = 0.9) -> str:
    """The text of its setup.toml."""
    return f"""\
schema = 1
[camera]
frame_rate_hz = {frame_rate_hz}
exposure_s = {exposure_s}
[beads]
radius_nm = 500.0
reference = ["ref1"]
[tether]
contour_length_nm = 1200.0
persistence_length_nm = 50.0
[buffer]
temperature_K = 298.15
viscosity_mPa_s = {viscosity_mPa_s}
[field]
direction = "x"
[model]
effects = ["wall_drag", "tracking_noise"]
"""
