"""The instrument around the beads: magnets that move and rest, a drifting and shaking stage.

Also what a tracker does wrong. Forces fall off exponentially with the magnets' distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera

STRONGEST_PN = 12.0
NEAREST_MM = 1.5
DECAY_MM = 1.6


def magnet_at_mm(force_pN: FloatArray) -> FloatArray:
    """Distance of the magnets at which the average bead feels a force."""
    return np.asarray(NEAREST_MM + DECAY_MM * np.log(STRONGEST_PN / force_pN))


def force_at_pN(magnet_mm: FloatArray) -> FloatArray:
    """Force on the average bead, the inverse of `magnet_at_mm`."""
    return np.asarray(STRONGEST_PN * np.exp((NEAREST_MM - magnet_mm) / DECAY_MM))


@dataclass(frozen=True)
class Staircase:
    """Magnet positions frame by frame: rests, and moves at constant speed between them.

    `edges` are the first frames of rest, move, rest, ..., and the end.
    """

    magnet_mm: FloatArray
    edges: tuple[int, ...]

    @property
    def segments(self) -> tuple[slice, ...]:
        """Rests and moves in time order; the even ones are rests."""
        return tuple(slice(a, b) for a, b in zip(self.edges, self.edges[1:], strict=False))

    @property
    def rests(self) -> tuple[slice, ...]:
        """The rests alone."""
        return self.segments[::2]


def staircase(position_mm: list[float], rest_frames: list[int], move_frames: int) -> Staircase:
    """Rests of given lengths at given positions, joined by moves of `move_frames`."""
    pieces, edges = [], [0]
    for i, (position, frames) in enumerate(zip(position_mm, rest_frames, strict=True)):
        if i:
            between = np.linspace(position_mm[i - 1], position, move_frames + 2)[1:-1]
            pieces.append(between)
            edges.append(edges[-1] + move_frames)
        pieces.append(np.full(frames, position))
        edges.append(edges[-1] + frames)
    return Staircase(np.concatenate(pieces), tuple(edges))


@dataclass(frozen=True)
class Stage:
    """Motion shared by all beads: steady, random, with the room's temperature, and shaking."""

    steady_nm_per_s: tuple[float, float, float]
    random_nm_per_root_s: tuple[float, float, float]
    swing_nm: tuple[float, float, float]
    swing_s: float
    shake_nm: tuple[float, float, float]
    shake_hz: float


def stage_motion(
    stage: Stage, camera: Camera, frames: int, random: np.random.Generator
) -> FloatArray:
    """(frames, 3) motion of the stage, 0 at the start but for the shaking."""
    time_s = camera.frame_s * np.arange(frames)[:, None]
    steps = random.normal(size=(frames, 3)) * np.sqrt(camera.frame_s)
    steps[0] = 0
    wander = np.cumsum(steps * np.array(stage.random_nm_per_root_s), axis=0)
    swing = np.array(stage.swing_nm) * np.sin(2 * np.pi * time_s / stage.swing_s)
    middle = time_s + camera.exposure_s / 2
    seen = np.array(stage.shake_nm) * np.sinc(stage.shake_hz * camera.exposure_s)
    shake = seen * np.sin(2 * np.pi * stage.shake_hz * middle)
    return np.asarray(np.array(stage.steady_nm_per_s) * time_s + wander + swing + shake)


def tracked(
    position_nm: FloatArray, noise_nm: tuple[float, float, float], random: np.random.Generator
) -> FloatArray:
    """Positions with the tracker's white noise."""
    return position_nm + np.array(noise_nm) * random.normal(size=position_nm.shape)


def bursts(
    number: int, longest: int, frames: int, random: np.random.Generator
) -> NDArray[np.bool_]:
    """(frames,) True in a number of short bursts at random times."""
    hit = np.zeros(frames, dtype=bool)
    for start in random.integers(1, frames - longest, size=number):
        hit[start : start + random.integers(1, longest + 1)] = True
    return hit


def mistracked(
    position_nm: FloatArray,
    where: NDArray[np.bool_],
    size_nm: tuple[float, float, float],
    random: np.random.Generator,
) -> FloatArray:
    """Positions with wrong ones in some frames: off by 0.5 to 1.5 times the size, either way."""
    wrong = position_nm.copy()
    shape = (int(where.sum()), 3)
    sign = random.choice([-1.0, 1.0], size=shape)
    wrong[where] += sign * random.uniform(0.5, 1.5, size=shape) * np.array(size_nm)
    return wrong
