"""The series that `series` measures: a tethered and a reference bead, drawn from seed and repeat.

Those of the joint Cramér–Rao bound that mtpipe is held to: eight plateaus from 0.3 to 20 pN, noise
of unknown size, wall friction, a radius known within 3 % whose stated value is drawn anew for each
repeat. And the same with a fault that the setup does not tell.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import numpy as np

from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.friction import (
    parallel_wall_factor,
    perpendicular_wall_factor,
    rotation_wall_factor,
    stokes_pN_s_per_nm,
)
from mtpipe.physics.langevin import simulate_axis
from mtpipe.physics.modes import SINGLE_MODE, Modes, rotating_bead
from mtpipe.physics.tether import Chain, mean_extension_nm, stiffness_pN_per_nm
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import parse_setup
from mtpipe.setup.usual_errors import exact

RATE_HZ, TEMPERATURE_K, VISCOSITY_MPA_S = 120.0, 293.15, 1.0
RADIUS_NM, RADIUS_SCATTER = 500.0, 0.03
FRAMES, NOISE_NM = 8192, 3.0
FORCES_PN = np.geomspace(0.3, 20.0, 8)
CHAIN = Chain(1200.0, 50.0, TEMPERATURE_K)
EXTENSIONS_NM = mean_extension_nm(CHAIN, FORCES_PN)
THERMAL_ENERGY = float(thermal_energy_pN_nm(TEMPERATURE_K))
# Noise of the reference bead over that of the tethered one: the factor that holds 68 %.
REFERENCE_NOISE_FACTOR = 1.5


@dataclass(frozen=True)
class Case:
    """A kind of series; what the setup does not say of it is a fault.

    Attributes
    ----------
    rotation : the bead turns about the field's axis, and the setup says so.
    friction : true over expected friction.
    across : true stiffness across the field over F/(L + R).
    odd_noise_nm, odd_drift_nm_per_s : in one plateau, drawn anew for each repeat.
    stated_radius : over the true one, apart from its scatter.
    """

    name: str
    rotation: bool = False
    friction: float = 1.0
    across: float = 1.0
    odd_noise_nm: float = NOISE_NM
    odd_drift_nm_per_s: float = 0.0
    stated_radius: float = 1.0

    @property
    def has_odd_plateau(self) -> bool:
        """Whether one plateau is unlike the others."""
        return self.odd_noise_nm != NOISE_NM or self.odd_drift_nm_per_s != 0


HELD, TURNS = Case("bead held"), Case("bead turns", rotation=True)
TRUE = (HELD, TURNS)
FAULTY = (
    Case("friction × 1.3", friction=1.3),
    Case("stiffness across × 0.9", across=0.9),
    Case("15 nm noise in one plateau", odd_noise_nm=15.0),
    Case("drift of 2 nm/s in one plateau", odd_drift_nm_per_s=2.0),
    Case("stated radius × 1.1", stated_radius=1.1),
)


@dataclass(frozen=True)
class Series:
    """One series drawn: setup, positions of bead and reference, the odd plateau, a generator."""

    setup: dict[str, object]
    bead_nm: np.ndarray
    reference_nm: np.ndarray
    odd: int
    random: np.random.Generator

    def recording(self, drift_nm_per_root_s: float = 0.0) -> Recording:
        """As `mtpipe.load` would give it, on a stage that drifts."""
        setup = parse_setup(exact(self.setup))
        n = len(self.bead_nm)
        drift = np.cumsum(self.random.normal(size=(n, 3)), axis=0)
        drift *= drift_nm_per_root_s / math.sqrt(RATE_HZ)
        time_s = np.arange(n) / RATE_HZ
        magnet_mm = np.repeat(np.arange(len(FORCES_PN), dtype=float), FRAMES)
        return Recording(
            name="simulated",
            setup=setup,
            time_s=time_s,
            frame=np.arange(n),
            positions_nm={"b1": self.bead_nm + drift, "ref1": self.reference_nm + drift},
            magnet_mm=magnet_mm,
            plateaus=find_plateaus(time_s, magnet_mm, setup.plateaus),
        )


def draw(case: Case, seed: int, repeat: int) -> Series:
    """The series of a seed and repeat."""
    random = np.random.default_rng([seed, zlib.crc32(case.name.encode()), repeat])
    odd = int(random.integers(len(FORCES_PN)))
    plateaus = [_plateau_nm(case, i, odd=i == odd, random=random) for i in range(len(FORCES_PN))]
    stated = RADIUS_NM * case.stated_radius * (1 + RADIUS_SCATTER * random.normal())
    noise = NOISE_NM * math.exp(math.log(REFERENCE_NOISE_FACTOR) * random.normal())
    bead = np.vstack(plateaus)
    return Series(_setup(case, stated), bead, noise * random.normal(size=bead.shape), odd, random)


def _setup(case: Case, radius_nm: float) -> dict[str, object]:
    """Content of the setup.toml."""
    rotation = ["rotation_coupling"] * case.rotation
    return {
        "schema": 1,
        "camera": {"frame_rate_hz": RATE_HZ, "exposure_s": 1 / RATE_HZ},
        "beads": {
            "radius_nm": radius_nm,
            "radius_nm_stderr": RADIUS_SCATTER * RADIUS_NM,
            "reference": ["ref1"],
        },
        "tether": {
            "contour_length_nm": CHAIN.contour_length_nm,
            "persistence_length_nm": CHAIN.persistence_length_nm,
        },
        "buffer": {"temperature_K": TEMPERATURE_K, "viscosity_mPa_s": VISCOSITY_MPA_S},
        "field": {"direction": "x"},
        "model": {"effects": ["wall_drag", "tracking_noise", *rotation]},
    }


def _plateau_nm(case: Case, plateau: int, *, odd: bool, random: np.random.Generator) -> np.ndarray:
    """(FRAMES, 3) positions of the bead in one plateau."""
    camera = Camera(1 / RATE_HZ, 1 / RATE_HZ)
    force, length = float(FORCES_PN[plateau]), float(EXTENSIONS_NM[plateau])
    height = length + RADIUS_NM
    stiffness = (
        force / length,
        case.across * force / height,
        float(stiffness_pN_per_nm(CHAIN, length)),
    )
    bulk = case.friction * float(stokes_pN_s_per_nm(RADIUS_NM, VISCOSITY_MPA_S))
    sideways = float(parallel_wall_factor(height, RADIUS_NM))
    walls = (sideways, sideways, float(perpendicular_wall_factor(height, RADIUS_NM)))
    across = SINGLE_MODE
    if case.rotation:
        ratio = 4 / 3 * RADIUS_NM**2 * float(rotation_wall_factor(height, RADIUS_NM)) / sideways
        across = rotating_bead(length, RADIUS_NM, ratio)
    modes: tuple[Modes, ...] = (SINGLE_MODE, across, SINGLE_MODE)
    motion = [
        simulate_axis(k, bulk * wall, THERMAL_ENERGY, camera, FRAMES, random, modes=mode)
        for k, wall, mode in zip(stiffness, walls, modes, strict=True)
    ]
    noise = case.odd_noise_nm if odd else NOISE_NM
    position = np.column_stack(motion) + noise * random.normal(size=(FRAMES, 3))
    position[:, 2] += length
    if odd:
        elapsed_s = np.arange(FRAMES) / RATE_HZ
        position[:, :2] += case.odd_drift_nm_per_s * elapsed_s[:, None]
    return position
