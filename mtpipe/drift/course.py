"""How strongly the stage wanders along z, from the beads themselves where no reference shows it.

A course in time that all beads share: a random walk, and a steady rate if the plateaus show one.
Within each plateau the lowest cosine coefficients of z are the walk's plus the tether's own thermal
motion. The walk is exactly diagonal in them (`lowpass`), coefficient j of n frames at the frequency
j/(2 n Δ); thermal motion is level below its corner
frequency, a level of its own for each bead and plateau. The magnets' forces change from plateau to
plateau and the extensions with them, so that nothing is learnt from the steps between plateaus.

Coefficients are independent and Gaussian, and beads share the stage's part of each: the likelihood
of the strength has a closed form but for the levels, which are fitted at every strength (Fisher's
scoring, Kay 1993, Fundamentals of Statistical Signal Processing I, 7.7).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import dct

from mtpipe.ground.types import FloatArray
from mtpipe.physics.walk import walk_variance_s
from mtpipe.recording.recording import StageCourse

# Cosine coefficients used of a plateau, those of up to 32 half periods: the motion most like that
# between plateaus, and below the corner frequency of a tether's axial motion.
LOWEST = 32
FRAMES_PER_COEFFICIENT = 8
# With fewer coefficients in all plateaus together the squared strength has an error of a factor of
# 1.6 or more.
FEWEST_COEFFICIENTS = 10
# Strengths that are tried: first over five decades, then where the likelihood is within exp(-12) of
# its largest.
DECADES, STRENGTHS, WITHIN = 5.0, 40, 12.0
# A walk by itself shows a rate: a steady one is believed from two standard errors on.
STEADY_SIGMAS = 2.0
ROUNDS, STEPS, LONGEST_STEP = 3, 10, 0.7
LEAST_LEVEL = 1e-12


@dataclass(frozen=True)
class Piece:
    """The lowest cosine coefficients of z in one plateau, of all beads that are tracked in it.

    Attributes
    ----------
    coefficients_nm : (beads, n). walk_s : (n,) their variance per nm²/s of a walk.
    ramp_s : (n,) what they are for a steady motion of 1 nm/s.
    angular_per_s : (n,) frequencies. faster_nm2 : (beads,) variance of all that is faster.
    frames, frame_s : their number and the time between them.
    """

    coefficients_nm: FloatArray
    walk_s: FloatArray
    ramp_s: FloatArray
    angular_per_s: FloatArray
    faster_nm2: FloatArray
    frames: int
    frame_s: float


def piece_of(z_nm: Sequence[FloatArray], frame_s: float) -> Piece | None:
    """The coefficients of one plateau; None where it is too short for any.

    Parameters
    ----------
    z_nm : of each bead (frames,), without lost frames.
    """
    frames = len(z_nm[0])
    count = min(LOWEST, frames // FRAMES_PER_COEFFICIENT)
    if count < 1:
        return None
    frequency_hz = np.arange(1, count + 1) / (2 * frames * frame_s)
    every = np.array([dct(z - z.mean(), norm="ortho") for z in z_nm])
    return Piece(
        coefficients_nm=every[:, 1 : count + 1],
        walk_s=walk_variance_s(frequency_hz, frame_s),
        ramp_s=dct(frame_s * np.arange(frames), norm="ortho")[1 : count + 1],
        angular_per_s=2 * math.pi * frequency_hz,
        faster_nm2=np.sum(every[:, count + 1 :] ** 2, axis=1) / frames,
        frames=frames,
        frame_s=frame_s,
    )


def fit_course(pieces: Sequence[Piece]) -> StageCourse | None:
    """Strength of the course that is in all pieces; None where they are too short to tell.

    The squared strength is its posterior mean under a flat prior, so that its own uncertainty is in
    it. Of the steady rate it is the size that explains
    best what the plateaus show beyond a walk, 0 where they hardly do.
    """
    if sum(len(piece.walk_s) for piece in pieces) < FEWEST_COEFFICIENTS:
        return None
    highest = max(float(np.mean(p.coefficients_nm**2 / p.walk_s)) for p in pieces)
    if not highest > 0:
        return StageCourse(0.0, 0.0, 0.0)
    top = math.log(highest) / 2
    ln_strength = np.linspace(top - DECADES * math.log(10), top, STRENGTHS)
    likely = _log_likelihood(np.exp(2 * ln_strength), pieces)[0]
    near = np.flatnonzero(likely > likely.max() - WITHIN)
    low, high = max(near[0] - 1, 0), min(near[-1] + 1, STRENGTHS - 1)
    ln_strength = np.linspace(ln_strength[low], ln_strength[high], STRENGTHS)
    walk_nm2_per_s = np.exp(2 * ln_strength)
    likely, steady = _log_likelihood(walk_nm2_per_s, pieces)
    weight = np.exp(likely - likely.max() + ln_strength)
    weight /= weight.sum()
    mean = float(weight @ np.exp(ln_strength))
    square = float(weight @ walk_nm2_per_s)
    return StageCourse(
        random_nm_per_root_s=math.sqrt(square),
        random_stderr_nm_per_root_s=math.sqrt(max(square - mean**2, 0.0)),
        steady_nm_per_s=math.sqrt(float(weight @ steady)),
    )


def _log_likelihood(
    walk_nm2_per_s: FloatArray, pieces: Sequence[Piece]
) -> tuple[FloatArray, FloatArray]:
    """(strengths,) of each strength of the walk, at the levels and the steady rate that suit it
    best, and (strengths,) the square of that rate's size in nm²/s²."""
    rate = np.zeros(len(walk_nm2_per_s))
    levels = [np.tile(_first_level(p), (len(rate), 1)) for p in pieces]
    for _ in range(ROUNDS):
        total, pull, weight = (np.zeros(len(rate)) for _ in range(3))
        for i, piece in enumerate(pieces):
            levels[i] = _fit_level(levels[i], piece, walk_nm2_per_s, rate)
            one = _one_piece(levels[i], piece, walk_nm2_per_s)
            total, pull, weight = total + one[0], pull + one[1], weight + one[2]
        # the size of a rate that is Gaussian about 0, where it makes the coefficients likeliest
        seen = np.where(pull**2 > STEADY_SIGMAS**2 * weight, pull**2 / weight, 1.0)
        rate = (1 - 1 / seen) * pull / weight
    return total + (seen - 1 - np.log(seen)) / 2, (seen - 1) / weight


def _first_level(piece: Piece) -> FloatArray:
    """(beads,) nm², mean power of the faster half of the coefficients."""
    return np.asarray(np.mean(piece.coefficients_nm[:, piece.walk_s.size // 2 :] ** 2, axis=1))


def _thermal_nm2(level: FloatArray, piece: Piece) -> FloatArray:
    """(strengths, beads, n) variance of the coefficients that is the tether's own motion.

    Level up to a corner frequency, which follows from level and whole variance of one relaxation.
    """
    whole = piece.faster_nm2 + level * len(piece.walk_s) / piece.frames
    relaxation_s = level * piece.frame_s / (2 * whole)
    roll_off = 1 + (relaxation_s[..., None] * piece.angular_per_s) ** 2
    return np.asarray(level[..., None] / roll_off)


def _shared(
    level: FloatArray, piece: Piece, walk_nm2_per_s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Thermal variance (strengths, beads, n), the sum of its inverses over the beads and the
    variance of the shared part once all beads are seen, both (strengths, n)."""
    thermal = _thermal_nm2(level, piece)
    inverse = np.sum(1 / thermal, axis=1)
    walk = walk_nm2_per_s[:, None] * piece.walk_s
    return thermal, inverse, walk / (1 + walk * inverse)


def _fit_level(
    level: FloatArray, piece: Piece, walk_nm2_per_s: FloatArray, rate: FloatArray
) -> FloatArray:
    """(strengths, beads) levels that are likeliest beside each strength and steady rate."""
    moved = piece.coefficients_nm - (rate[:, None] * piece.ramp_s)[:, None, :]
    least = LEAST_LEVEL * max(float(np.max(piece.coefficients_nm**2)), LEAST_LEVEL)
    for _ in range(STEPS):
        thermal, inverse, shared = _shared(level, piece, walk_nm2_per_s)
        stage = shared * np.sum(moved / thermal, axis=1)
        part = shared[:, None, :] / thermal
        slope = np.sum((moved - stage[:, None, :]) ** 2 / thermal - 1 + part, axis=2)
        # levels of several beads bear on one another: the sum over a row of the information
        # bounds it from above, and steps do not overshoot
        others = part * (shared * inverse)[:, None, :] - part**2
        information = np.sum((1 - part) ** 2 + others, axis=2)
        step = slope / np.maximum(information, 1e-9)
        level = np.maximum(level * np.exp(np.clip(step, -LONGEST_STEP, LONGEST_STEP)), least)
    return level


def _one_piece(
    level: FloatArray, piece: Piece, walk_nm2_per_s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(strengths,) log likelihood without a steady rate; what the rate's best value times its
    weight is, and the weight, its inverse variance."""
    thermal, inverse, shared = _shared(level, piece, walk_nm2_per_s)
    seen = piece.coefficients_nm
    toward = np.sum(seen / thermal, axis=1)
    alone = 1 + walk_nm2_per_s[:, None] * piece.walk_s * inverse
    deviance = np.sum(np.log(thermal) + seen**2 / thermal, axis=(1, 2))
    deviance += np.sum(np.log(alone) - shared * toward**2, axis=1)
    pull = np.sum(piece.ramp_s * toward / alone, axis=1)
    return -deviance / 2, pull, np.sum(piece.ramp_s**2 * inverse / alone, axis=1)
