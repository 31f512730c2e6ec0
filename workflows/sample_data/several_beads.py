"""`several_beads`: a field of view as a microscope has it, with good beads and bad ones.

Six beads over one staircase of forces: three on single tethers, one on two tethers, one stuck to
the surface, one that nothing holds; two reference beads, of which one slips and is loose after.
The stage drifts and shakes, frames are lost, and one bead is mistracked at times.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from beads import Fluid, Tethered, free_trace, state, tethered_trace
from instrument import (
    Stage,
    bursts,
    force_at_pN,
    magnet_at_mm,
    mistracked,
    stage_motion,
    staircase,
    tracked,
)

from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_mode

SEED = 2026
CAMERA = Camera(frame_s=1 / 120, exposure_s=0.007)
FLUID = Fluid(temperature_K=296.15, viscosity_mPa_s=0.932)
RADIUS_NM, RADIUS_STDERR_NM, CONTOUR_NM = 1400.0, 20.0, 2700.0
FORCES_PN = np.geomspace(12.0, 0.3, 6)
# few relaxation times fit into a rest at low force, so rests grow longer
REST_FRAMES = [3000, 3000, 3500, 4000, 5000, 6000]
MOVE_FRAMES = 180
TETHERED = {
    "b1": ("one tether", Tethered(1388.0, CONTOUR_NM, 50.0, 0.94)),
    "b2": ("one tether; mistracked in some frames", Tethered(1412.0, CONTOUR_NM, 50.0, 1.05)),
    "b3": ("one tether; often lost by the tracker", Tethered(1401.0, CONTOUR_NM, 50.0, 1.0)),
    "b4": ("two tethers side by side", Tethered(1395.0, CONTOUR_NM, 25.0, 1.02)),
}
STUCK, FREE = "b5", "b6"
NOISE_NM, REFERENCE_NOISE_NM = (1.5, 1.5, 2.5), (0.8, 0.8, 1.4)
STAGE = Stage(
    steady_nm_per_s=(0.5, -0.3, 0.8),
    random_nm_per_root_s=(1.0, 1.0, 1.5),
    swing_nm=(20.0, 15.0, 60.0),
    swing_s=170.0,
    shake_nm=(2.5, 1.2, 1.0),
    shake_hz=24.6,
)
SLIPS_AT_FRAME, SLIP_NM = 13_000, (28.0, -11.0, 6.0)
LOOSE_NM, LOOSE_S = (6.0, 5.0, 4.0), 0.2

SETUP = f"""\
# Six tethered beads and two reference beads, simulated (workflows/sample_data/several_beads.py).
schema = 1

[camera]
frame_rate_hz = 120.0
exposure_s = {CAMERA.exposure_s}

[beads]
radius_nm = {RADIUS_NM}
radius_nm_stderr = {RADIUS_STDERR_NM}
reference = ["ref1", "ref2"]

[tether]
contour_length_nm = {CONTOUR_NM}
persistence_length_nm = 50.0

[buffer]
temperature_K = {FLUID.temperature_K}
viscosity_mPa_s = {FLUID.viscosity_mPa_s}

[field]
direction = "x"

[model]
effects = ["wall_drag", "rotation_coupling", "tracking_noise"]
"""


def files() -> dict[str, bytes | dict[str, Any]]:
    """Content of the folder: text as bytes, truth as a dictionary."""
    magnets = staircase(list(np.round(magnet_at_mm(FORCES_PN), 3)), REST_FRAMES, MOVE_FRAMES)
    frames = len(magnets.magnet_mm)
    force = force_at_pN(magnets.magnet_mm)
    common = stage_motion(STAGE, CAMERA, frames, _random(0))
    seen: dict[str, FloatArray] = {}
    truth: dict[str, Any] = {}
    for number, (name, (what, bead)) in enumerate(TETHERED.items(), start=1):
        random = _random(number)
        own = bead.force_ratio * force
        parts = [tethered_trace(bead, own[s], FLUID, CAMERA, random) for s in magnets.segments]
        seen[name] = tracked(np.concatenate(parts) + common, NOISE_NM, random)
        truth[name] = truth_of(what, bead, [float(own[s.start]) for s in magnets.rests], FLUID)
    random = _random(5)
    still = np.array([0.0, 0.0, 12.0])
    seen[STUCK] = tracked(common + still, NOISE_NM, random)
    truth[STUCK] = {"what": "stuck to the surface"}
    random = _random(6)
    free = free_trace(RADIUS_NM, 0.03, FLUID, CAMERA, frames, random)
    seen[FREE] = tracked(free + common, NOISE_NM, random)
    truth[FREE] = {"what": "held by nothing, diffuses over the surface"}
    seen["ref1"] = tracked(common, REFERENCE_NOISE_NM, _random(7))
    random = _random(8)
    seen["ref2"] = tracked(common + _slipping(frames, random), REFERENCE_NOISE_NM, random)
    _spoil(seen, truth, magnets.rests[3], frames)
    text = _table(magnets.magnet_mm, seen, frames)
    return {"setup.toml": SETUP.encode(), "recording.csv.gz": text, "truth.json": truth}


def truth_of(what: str, bead: Tethered, forces_pN: list[float], fluid: Fluid) -> dict[str, Any]:
    """What was simulated, a number per plateau."""
    states = [state(bead, force, fluid) for force in forces_pN]
    return {
        "what": what,
        "contour_length_nm": bead.contour_nm,
        "persistence_length_nm": bead.persistence_nm,
        "chain": "bouchiat",
        "force_pN": [round(s.force_pN, 6) for s in states],
        "extension_nm": [round(s.extension_nm, 3) for s in states],
        "friction_pN_s_per_nm": [
            float(f"{s.friction_along_surface_pN_s_per_nm:.6g}") for s in states
        ],
        "friction_z_pN_s_per_nm": [
            float(f"{s.friction_from_surface_pN_s_per_nm:.6g}") for s in states
        ],
    }


def _slipping(frames: int, random: np.random.Generator) -> FloatArray:
    """A reference bead that lets go of one of its bonds: it jumps, and wobbles from then on."""
    motion = np.zeros((frames, 3))
    after = frames - SLIPS_AT_FRAME
    for axis in range(3):
        wobble = simulate_mode(LOOSE_NM[axis] ** 2, LOOSE_S, CAMERA, after, random)
        motion[SLIPS_AT_FRAME:, axis] = SLIP_NM[axis] + wobble
    return motion


def _spoil(seen: dict[str, FloatArray], truth: dict[str, Any], worst: slice, frames: int) -> None:
    """Mistracked frames of b2, lost frames of all beads and many of b3 during one plateau."""
    random = _random(9)
    where = bursts(25, 4, frames, random)
    seen["b2"] = mistracked(seen["b2"], where, (400.0, 400.0, 2500.0), random)
    truth["b2"]["mistracked_frames"] = int(where.sum())
    for position in seen.values():
        position[bursts(8, 3, frames, random)] = np.nan
    length = worst.stop - worst.start
    seen["b3"][worst][bursts(60, 12, length, random)] = np.nan


def _table(magnet_mm: FloatArray, seen: dict[str, FloatArray], frames: int) -> bytes:
    """The canonical table, without the frames that the camera lost."""
    kept = ~bursts(12, 6, frames, _random(10))
    # lateral places in the field of view, nm
    places = np.round(_random(11).uniform(4000, 56000, size=(len(seen), 2)), 1)
    names = ["time_s", "magnet_mm", *(f"{bead}_{axis}_nm" for bead in seen for axis in "xyz")]
    place = [[x, y, 0.0] for x, y in places]
    columns = np.hstack([p + at for p, at in zip(seen.values(), place, strict=True)])
    lines = [",".join(names)]
    for frame in np.flatnonzero(kept):
        cells = ("" if np.isnan(v) else f"{v:.2f}" for v in columns[frame])
        lines.append(f"{frame * CAMERA.frame_s:.6f},{magnet_mm[frame]:.4f}," + ",".join(cells))
    return ("\n".join(lines) + "\n").encode()


def _random(stream: int) -> np.random.Generator:
    return np.random.default_rng([SEED, stream])
