"""Frames that are missing at random while the file counts on (PHYSICS E13).

With a share p missing, successive rows are g frames apart with probability (1 − p) p^(g−1). What
one frame and the next have in common, a factor q, is in the mean over g (1 − p) q/(1 − p q) of one
row and the next. A motion has a real q = e^(−D/τ); a wave's is complex, q = e^(2πi f D).
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Common = TypeVar("Common", NDArray[np.float64], complex)


def between_rows(q: Common, share: float) -> Common:
    """What a row and the next have in common, of what a frame and the next have."""
    return (1 - share) * q / (1 - share * q)


def wave_hz_by_frames(recorded_hz: float, frame_s: float, share: float) -> float:
    """Frequency of the steady wave that a file without its lost frames shows at `recorded_hz`.

    It is the slower one, as rows are more than a frame apart: with q' = ρ e^(2πi f' D) between
    rows, q = q'/(1 − p + p q') has the modulus 1 of a steady wave, which makes ρ the positive
    solution of (1 − p²) ρ² − 2 p (1 − p) ρ cos 2πf'D − (1 − p)² = 0.
    """
    if share <= 0:
        return recorded_hz
    angle = 2 * math.pi * recorded_hz * frame_s
    half = share * (1 - share) * math.cos(angle)
    square = 1 - share**2
    size = (half + math.sqrt(half**2 + square * (1 - share) ** 2)) / square
    row = size * complex(math.cos(angle), math.sin(angle))
    frame = row / (1 - share + share * row)
    return math.atan2(frame.imag, frame.real) / (2 * math.pi * frame_s)
