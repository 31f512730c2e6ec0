"""What a vibration adds to a plateau's expected spectra, and to how far its mean is known."""

from __future__ import annotations

import cmath
import functools
import math

import numpy as np

from mtpipe.experiment.description import Line
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.data import PlateauData
from mtpipe.joint_fit.motions import DIAGONAL
from mtpipe.physics.lost_frames import between_rows, wave_hz_by_frames


def add_line(power: FloatArray, line: Line, data: PlateauData, dropped_share: float) -> None:
    """Add a vibration's power, in place.

    In what phase the axes vibrate is not known, so each has it by itself.
    """
    wave = _wave(data, line.frequency_hz, line.coherence_s, dropped_share)
    power[:, DIAGONAL, DIAGONAL] += np.square(line.amplitude_nm) * wave


def of_mean_nm2(line: Line, data: PlateauData) -> float:
    """Variance of the mean height by a vibration of unknown phase, at most that of a steady one."""
    periods = line.frequency_hz * data.duration_s
    return float(line.amplitude_nm[2] ** 2 / 2 * np.sinc(periods) ** 2)


@functools.lru_cache(maxsize=1024)
def _wave(
    data: PlateauData, frequency_hz: float, coherence_s: float, dropped_share: float
) -> FloatArray:
    """(n_bins, 3) power of a wave of 1 nm, the mean over its phase.

    A wave between two ordinates is in several, and so in two bins where it is at the edge of one.
    Each frame that is lost shifts its phase (PHYSICS E13).
    """
    spectrum = data.spectrum
    frame_s = spectrum.windows[0].frame_s
    by_frames_hz = wave_hz_by_frames(frequency_hz, frame_s, dropped_share)
    frame = cmath.exp(frame_s * (2j * math.pi * by_frames_hz - 1 / coherence_s))
    row = between_rows(frame, dropped_share)
    rows = np.arange(spectrum.used.shape[1] + 1)
    covariance = abs(row) ** rows * np.cos(cmath.phase(row) * rows) / 2
    return spectrum.expected_power(covariance)
