"""Parts of simulated stages whose motion is known, for the tests of drift subtraction."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from mtpipe.recording.recording import Plateau, Recording
from mtpipe.setup.setup import parse_setup

RATE_HZ = 120.0
N = 16384


def setup_of(references: list[str]):
    return parse_setup(
        {
            "schema": 1,
            "camera": {"frame_rate_hz": RATE_HZ, "exposure_s": 1 / RATE_HZ},
            "beads": {"radius_nm": 1400.0, "reference": references},
            "tether": {"contour_length_nm": 2700.0, "persistence_length_nm": 50.0},
            "buffer": {"temperature_K": 298.15, "viscosity_mPa_s": 0.89},
            "field": {"direction": "x"},
        }
    )


def recording_of(positions, references, *, frame=None, plateaus=None) -> Recording:
    n = len(next(iter(positions.values())))
    frame = np.arange(n) if frame is None else frame
    plateaus = (Plateau(0, 0, n, None),) if plateaus is None else plateaus
    return Recording(
        "simulated", setup_of(references), frame / RATE_HZ, frame, positions, None, plateaus
    )


def ou(rng, n, rms_nm, corner_hz):
    q = np.exp(-2 * np.pi * corner_hz / RATE_HZ)
    kicks = rms_nm * np.sqrt(1 - q**2) * rng.standard_normal((n, 3))
    return lfilter([1], [1, -q], kicks, axis=0)


def walk(rng, n, step_nm):
    return np.cumsum(step_nm * rng.standard_normal((n, 3)), axis=0)


def codes(recording: Recording) -> list[tuple[str, str | None]]:
    return [(n.code, n.bead) for n in recording.notices]
