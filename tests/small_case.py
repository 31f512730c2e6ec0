"""A small simulated recording for the tests of fit, battery and cross-check, made in a second."""

from __future__ import annotations

from typing import Any

import numpy as np

from mtpipe.crosschecking.lines import with_lines_apart
from mtpipe.crosschecking.prepared_bead import PreparedBead, prepare
from mtpipe.drift import subtract_drift
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.usual_errors import exact
from mtpipe.simulation.simulate import simulate

FORCES_PN = (0.6, 2.0, 7.0)
FRAMES, NOISE_NM = 2048, (2.0, 2.0, 3.0)


def setup(**changes: dict[str, Any]) -> Setup:
    """A setup in which everything is known; tables may be changed."""
    content: dict[str, Any] = {
        "schema": 1,
        "camera": {"frame_rate_hz": 120.0, "exposure_s": 0.005},
        "beads": {"radius_nm": 1400.0, "reference": ["ref1"]},
        "tether": {"contour_length_nm": 2700.0, "persistence_length_nm": 50.0},
        "buffer": {"temperature_K": 298.15, "viscosity_mPa_s": 0.89},
        "field": {"direction": "x"},
        "model": {"effects": ["wall_drag", "rotation_coupling", "tracking_noise"]},
    }
    for name, table in changes.items():
        content[name] = content[name] | table
    return parse_setup(exact(content), where="test")


def raw(seed: int, lost_share: float = 0.0, **changes: dict[str, Any]) -> Recording:
    """A clean recording as a laboratory has it."""
    return simulate(
        setup(**changes), FORCES_PN, FRAMES, seed, noise_nm=NOISE_NM, lost_share=lost_share
    )


def case(recording: Recording) -> PreparedBead:
    """Its bead, fitted."""
    return with_lines_apart(prepare(subtract_drift(recording), "b1"))


def generator(*seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)
