"""Simulated recordings for tests: a tethered bead and a reference bead on a drifting stage."""

from __future__ import annotations

import numpy as np

from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.friction import parallel_wall_factor, stokes_pN_s_per_nm
from mtpipe.physics.langevin import simulate_axis
from mtpipe.physics.tether import Chain, mean_extension_nm, stiffness_pN_per_nm
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.usual_errors import exact

RATE_HZ = 120.0
TEMPERATURE_K = 298.15
CHAIN = Chain(1200.0, 50.0, TEMPERATURE_K)
RADIUS_NM = 500.0
VISCOSITY_MPA_S = 0.9


def setup_content(**changes) -> dict:
    """Content of a setup.toml; `changes` replace whole tables."""
    content = {
        "schema": 1,
        "camera": {"frame_rate_hz": RATE_HZ, "exposure_s": 1 / RATE_HZ},
        "beads": {"radius_nm": RADIUS_NM, "reference": ["ref1"]},
        "tether": {"contour_length_nm": 1200.0, "persistence_length_nm": 50.0},
        "buffer": {"temperature_K": TEMPERATURE_K, "viscosity_mPa_s": VISCOSITY_MPA_S},
        "field": {"direction": "x"},
        "model": {"effects": ["wall_drag", "tracking_noise"]},
    }
    return exact(content | changes)


def bead_nm(
    force_pN, frames, random, *, exposure_s=1 / RATE_HZ, noise_nm=1.3, friction=1.0, chain=CHAIN
):
    """(frames, 3) positions of a tethered bead at one force; `friction` scales the lateral one."""
    camera, kT = Camera(1 / RATE_HZ, exposure_s), float(thermal_energy_pN_nm(TEMPERATURE_K))
    length = float(mean_extension_nm(chain, force_pN))
    gamma = float(stokes_pN_s_per_nm(RADIUS_NM, VISCOSITY_MPA_S))
    gamma *= friction * float(parallel_wall_factor(length + RADIUS_NM, RADIUS_NM))
    stiffness = (
        force_pN / length,
        force_pN / (length + RADIUS_NM),
        float(stiffness_pN_per_nm(chain, length)),
    )
    motion = [simulate_axis(k, gamma, kT, camera, frames, random) for k in stiffness]
    noise = noise_nm * random.normal(size=(frames, 3))
    return np.column_stack(motion) + np.array([0.0, 0.0, length]) + noise


def recording(
    forces_pN=(0.5, 2.0, 6.0),
    frames=4096,
    seed=0,
    *,
    setup: Setup | None = None,
    beads=None,
    drift_nm_per_root_s=1.0,
) -> Recording:
    """A recording with plateaus of the given forces.

    `beads` : name → (n_plateaus·frames, 3) positions, in place of the one tethered bead `b1`.
    """
    random = np.random.default_rng(seed)
    n = frames * len(forces_pN)
    if beads is None:
        beads = {"b1": np.vstack([bead_nm(force, frames, random) for force in forces_pN])}
    drift = np.cumsum(random.normal(size=(n, 3)), axis=0) * drift_nm_per_root_s / RATE_HZ**0.5
    positions = {name: xyz + drift + [4000.0, 3000.0, 0.0] for name, xyz in beads.items()}
    positions["ref1"] = drift + random.normal(size=(n, 3)) + [9000.0, 500.0, 0.0]
    time_s = np.arange(n) / RATE_HZ
    magnet_mm = np.repeat(np.arange(len(forces_pN), dtype=float), frames)
    setup = setup or parse_setup(setup_content())
    return Recording(
        name="simulated",
        setup=setup,
        time_s=time_s,
        frame=np.arange(n),
        positions_nm=positions,
        magnet_mm=magnet_mm,
        plateaus=find_plateaus(time_s, magnet_mm, setup.plateaus),
    )
