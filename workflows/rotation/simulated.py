"""Simulated recordings of beads that are turned: one nicked or whole molecule, or two of them.

Means are those of `mtpipe.physics.turned_tethers`, each molecule with buckling, slope and braid of
its own; the height fluctuates in time with the tether's softness and the surface's friction, the
tracker adds noise, a bead that is recorded askew follows the angle, and the stage drifts.
"""

from __future__ import annotations

import itertools

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.friction import stokes_pN_s_per_nm
from mtpipe.physics.tether import Chain, mean_extension_nm, stiffness_pN_per_nm
from mtpipe.physics.turned_tethers import (
    shortened_by_braiding_nm,
    shortened_by_coiling_nm,
    supercoiling,
)
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import parse_setup

RATE_HZ, TEMPERATURE_K, RADIUS_NM, PERSISTENCE_NM = 50.0, 298.15, 500.0, 50.0
KINDS = ("nicked", "supercoilable", "several tethers")
SECONDS_PER_TURN = 1.0


def setup_content(contour_nm: float) -> dict[str, object]:
    """Of the setup that the recordings go with."""
    return {
        "schema": 1,
        "camera": {"frame_rate_hz": RATE_HZ, "exposure_s": 1 / RATE_HZ},
        "beads": {"radius_nm": RADIUS_NM, "reference": []},
        "tether": {"contour_length_nm": contour_nm, "persistence_length_nm": PERSISTENCE_NM},
        "buffer": {"temperature_K": TEMPERATURE_K, "viscosity_mPa_s": 0.9},
        "field": {"direction": "x"},
        "model": {"effects": []},
    }


def there_and_back(low: float, high: float) -> FloatArray:
    """Turns of the magnets, frame by frame: waiting at 0, up, down, and back to 0."""
    ends = [0.0, high, low, 0.0]
    parts = [np.zeros(int(10 * RATE_HZ))]
    for a, b in itertools.pairwise(ends):
        parts.append(np.linspace(a, b, max(2, int(abs(b - a) * SECONDS_PER_TURN * RATE_HZ))))
    return np.concatenate(parts)


def heights_nm(
    kind: str,
    turns: FloatArray,
    force_pN: float,
    contour_nm: float,
    random: np.random.Generator,
) -> FloatArray:
    """Height of one bead, frame by frame."""
    kT = float(thermal_energy_pN_nm(TEMPERATURE_K))
    tethers = 2 if kind == "several tethers" else 1
    chain = Chain(contour_nm, PERSISTENCE_NM, TEMPERATURE_K)
    top = float(mean_extension_nm(chain, force_pN / tethers))
    away = turns - random.uniform(-2, 2)
    lost = np.zeros_like(turns)
    if kind == "supercoilable":
        coiling = supercoiling(force_pN, contour_nm, PERSISTENCE_NM, kT)
        lost = shortened_by_coiling_nm(away * random.normal(1, 0.1), coiling)
        if force_pN > random.normal(3.0, 0.2):  # an overwound one changes its form
            lost = np.where(away > 0, 0.0, lost)
        melted = force_pN > random.normal(0.8, 0.1)  # an unwound molecule melts
        lost = np.where(melted & (away < 0), 0.0, lost)
    elif kind == "several tethers":
        spacing = random.uniform(0.1, 0.6) * min(2 * RADIUS_NM, top)
        lost = shortened_by_braiding_nm(away, force_pN, top, spacing, PERSISTENCE_NM, kT)
        lost = lost * random.uniform(0.6, 1.7)
    mean = np.maximum(top - lost, 20.0)
    soft = float(stiffness_pN_per_nm(chain, np.minimum(top, 0.97 * contour_nm))) * tethers
    relaxation_s = 3 * float(stokes_pN_s_per_nm(RADIUS_NM, 0.9)) / soft
    keep = np.exp(-1 / (RATE_HZ * relaxation_s))
    steps = random.normal(size=len(turns)) * np.sqrt(kT / soft * (1 - keep**2))
    motion = np.empty_like(steps)
    value = 0.0
    for n, step in enumerate(steps):
        value = keep * value + step
        motion[n] = value
    askew = random.uniform(0, 60) * np.cos(2 * np.pi * turns + random.uniform(0, 7))
    drift = np.cumsum(random.normal(size=len(turns))) / RATE_HZ**0.5 * 1.0
    return np.maximum(mean + motion, 0.0) + askew + drift + random.normal(size=len(turns)) * 3


def recording(
    beads: dict[str, str],
    force_pN: float,
    contour_nm: float,
    random: np.random.Generator,
    *,
    low: float = -30.0,
    high: float = 30.0,
) -> Recording:
    """A recording of beads of such kinds at one position of the magnets, which rotate."""
    turns = there_and_back(low, high)
    time_s, magnet_mm = np.arange(len(turns)) / RATE_HZ, np.full(len(turns), 2.0)
    setup = parse_setup(setup_content(contour_nm))
    positions = {
        name: np.column_stack(
            [
                *random.normal(size=(2, len(turns))),
                heights_nm(kind, turns, force_pN, contour_nm, random),
            ]
        )
        for name, kind in beads.items()
    }
    plateaus = find_plateaus(time_s, magnet_mm, setup.plateaus, np.abs(turns) == 0)
    return Recording(
        "turned", setup, time_s, np.arange(len(turns)), positions, magnet_mm, plateaus,
        magnet_turns=turns,
    )  # fmt: skip
