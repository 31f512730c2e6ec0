"""Known effects that are put by numbers into a bead's recorded positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import Recording

# Of a vibration, in Hz: no real line of the recordings is near.
LINE_HZ = 7.3
# Of hopping: how often a second the tether changes its length.
HOPS_HZ = 2.0


@dataclass(frozen=True)
class Injection:
    """One kind of effect.

    Attributes
    ----------
    effect : its name; empty: the setup lists it, so that nothing may be named for it.
    strengths : weak, moderate, strong. put : into (n, 3) positions at (n,) times.
    size : the parameter that is compared; together : its value once nature's own (what the bead
        has without the injection, or none) and the injected strength are both there.
    in_each_plateau : it is put into each plateau by itself, so that none gets frames of another.
    """

    effect: str
    strengths: tuple[float, float, float]
    put: Callable[[FloatArray, FloatArray, float, np.random.Generator], FloatArray]
    size: str = ""
    none: float = 0.0
    together: Callable[[float, float], float] = lambda own, put: own + put
    in_each_plateau: bool = False


def _scaled(
    position_nm: FloatArray, time_s: FloatArray, share: float, random: np.random.Generator
) -> FloatArray:
    middle = np.nanmean(position_nm[:, 1])
    moved = position_nm.copy()
    moved[:, 1] = middle + (1 + share) * (position_nm[:, 1] - middle)
    return moved


def _shared(
    position_nm: FloatArray, time_s: FloatArray, share: float, random: np.random.Generator
) -> FloatArray:
    moved = position_nm.copy()
    moved[:, 2] += share * (position_nm[:, 0] - np.nanmean(position_nm[:, 0]))
    return moved


def _noisy(
    position_nm: FloatArray, time_s: FloatArray, size_nm: float, random: np.random.Generator
) -> FloatArray:
    return position_nm + size_nm * random.normal(size=position_nm.shape)


def _shaken(
    position_nm: FloatArray, time_s: FloatArray, size_nm: float, random: np.random.Generator
) -> FloatArray:
    moved = position_nm.copy()
    moved[:, 1] += size_nm * np.sin(2 * np.pi * (LINE_HZ * time_s + random.random()))
    return moved


def _drifting(
    position_nm: FloatArray, time_s: FloatArray, walk_nm: float, random: np.random.Generator
) -> FloatArray:
    steps = np.sqrt(np.diff(time_s, prepend=time_s[0]))[:, None]
    return position_nm + walk_nm * np.cumsum(steps * random.normal(size=position_nm.shape), axis=0)


def _hopping(
    position_nm: FloatArray, time_s: FloatArray, step_nm: float, random: np.random.Generator
) -> FloatArray:
    changes = random.random(len(time_s)) < -np.expm1(
        -HOPS_HZ * np.diff(time_s, prepend=time_s[0]).clip(0.0, 1.0)
    )
    moved = position_nm.copy()
    moved[:, 2] += step_nm * (np.cumsum(changes) % 2)
    return moved


def _dropped(
    position_nm: FloatArray, time_s: FloatArray, share: float, random: np.random.Generator
) -> FloatArray:
    """Later frames move up, as the file counts on; the bead is lost at the end."""
    kept = position_nm[random.random(len(time_s)) >= share]
    moved = np.full_like(position_nm, np.nan)
    moved[: len(kept)] = kept
    return moved


INJECTIONS = {
    "scale": Injection(
        "lateral_scale", (0.04, 0.08, 0.16), _scaled, "factor_y", 1.0, lambda own, s: own * (1 + s)
    ),
    "crosstalk": Injection("z_crosstalk", (0.04, 0.08, 0.16), _shared, "slope_x"),
    # of 2 nm nobody can see anything here: it is expected to gain 0.1 and 1.2 nats in b1 of
    # cmaddry-run1 and of run2; 16 nm gains more than forty in both
    "line": Injection(
        "vibration", (8.0, 16.0, 32.0), _shaken, "amplitude_y_nm", 0.0, lambda own, put: put
    ),
    # of 1 nm/√s the fit of b1 of cmaddry-run1 gains 12 nats, of which naming costs 8
    "drift": Injection(
        "drift", (1.0, 2.0, 4.0), _drifting, "walk_z_nm_per_root_s", 0.0, lambda own, put: float(
            np.hypot(own, put)
        ),
    ),
    "hopping": Injection("hopping", (10.0, 20.0, 40.0), _hopping, "step_nm"),
    "dropped": Injection(
        "dropped_frames", (0.02, 0.08, 0.2), _dropped, "share", 0.0, lambda own, put: (
            1 - (1 - own) * (1 - put)
        ), in_each_plateau=True,
    ),
    "noise": Injection("", (1.0, 2.0, 4.0), _noisy),
}  # fmt: skip


def injected(recording: Recording, bead: str, kind: str, strength: float, seed: int) -> Recording:
    """A drift-subtracted recording with an effect in one bead's positions."""
    random = np.random.default_rng(seed)
    positions, time_s = recording.positions_nm[bead], recording.time_s
    one = INJECTIONS[kind]
    if one.in_each_plateau:
        moved = positions.copy()
        for plateau in recording.plateaus:
            rows = slice(plateau.start, plateau.stop)
            moved[rows] = one.put(positions[rows], time_s[rows], strength, random)
    else:
        moved = one.put(positions, time_s, strength, random)
    return replace(recording, positions_nm={**recording.positions_nm, bead: moved})
