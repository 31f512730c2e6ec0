"""`laboratory_text`: two tethered beads and a reference as a laboratory's own programs write them.

The tracker's file has no header: frame counter, then x and y in pixels and z in µm of every bead,
as the objective moves, not corrected for refraction; `-1.#IND000` where it lost a bead. The motor
has a log of its own: milliseconds of its own clock, the motor's position (larger is closer), turns.
First the magnets are far away and the beads lie on the surface, which tells where z = 0 is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from beads import Fluid, Tethered, resting_trace, tethered_trace
from instrument import (
    Stage,
    Staircase,
    bursts,
    force_at_pN,
    magnet_at_mm,
    stage_motion,
    staircase,
    tracked,
)
from several_beads import truth_of

from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera

SEED = 2027
CAMERA = Camera(frame_s=1 / 150, exposure_s=1 / 150)
FLUID = Fluid(temperature_K=297.65, viscosity_mPa_s=0.900)
RADIUS_NM, RADIUS_STDERR_NM, CONTOUR_NM = 1400.0, 20.0, 1700.0
WEIGHT_PN = 0.045  # a bead of 2.8 µm and 1.4 g/cm³ in water
PIXEL_NM, REFRACTION = 108.3, 0.88
FORCES_PN = np.geomspace(0.3, 12.0, 6)
TOUCH_FRAMES, FAR_MM = 2100, 16.0
REST_FRAMES = [6000, 4500, 3900, 3300, 2700, 2700]
MOVE_FRAMES = 300
BEADS = {
    "b1": Tethered(1391.0, CONTOUR_NM, 48.0, 1.04),
    "b2": Tethered(1409.0, CONTOUR_NM, 48.0, 0.97),
}
# the tracker's z of the surface differs from bead to bead with their look-up tables
SURFACE_NM = {"ref": 1180.0, "b1": 1432.0, "b2": 1259.0}
NOISE_NM, REFERENCE_NOISE_NM = (1.8, 1.8, 3.0), (1.0, 1.0, 1.6)
STAGE = Stage(
    steady_nm_per_s=(-0.4, 0.2, -0.9),
    random_nm_per_root_s=(0.8, 0.8, 1.5),
    swing_nm=(10.0, 10.0, 40.0),
    swing_s=120.0,
    shake_nm=(0.0, 0.0, 0.0),
    shake_hz=0.0,
)
FIRST_FRAME = 18_211
MOTOR_HOME_MM, MOTOR_NOISE_MM, LOG_STEP_S = 22.0, 0.002, 0.05
CLOCK_OFFSET_S = 87.25  # motor's clock to camera's
RECORDING, LOG = "chip3_r012.txt.gz", "chip3_r012_motor.txt"

SETUP = f"""\
# A tracker's and a motor's own text files, simulated (workflows/sample_data/laboratory_text.py).
schema = 1

[camera]
frame_rate_hz = 150.0
exposure_s = 0.0066667
pixel_size_nm = {PIXEL_NM}

[beads]
radius_nm = {RADIUS_NM}
radius_nm_stderr = {RADIUS_STDERR_NM}
reference = ["ref"]

[tether]
contour_length_nm = {CONTOUR_NM}
persistence_length_nm = 48.0

[buffer]
temperature_K = {FLUID.temperature_K}
viscosity_mPa_s = {FLUID.viscosity_mPa_s}

[field]
direction = "x"

[model]
effects = ["wall_drag", "rotation_coupling", "tracking_noise"]

[plateaus]
minimum_s = 16.0                # the rest on the surface at the beginning is shorter
tolerance_mm = 0.02             # above the motor's noise
settle_s = 0.5

[source]
files = "{RECORDING}"
format = "text"
delimiter = "tab"
header = false
units = {{ x = "pixel", y = "pixel", z = "um" }}
scale = {{ z = {REFRACTION} }}            # refraction at the surface
lost = {{ tokens = ["-1.#IND000"] }}
frame = {{ column = 1 }}

[[source.beads]]
first_column = 2
order = "xyz"
names = ["ref", "b1", "b2"]

[source.magnet]
file = "{LOG}"
format = "text"
delimiter = "tab"
header = false
time_column = 1
time_unit = "ms"
clock_offset_s = {CLOCK_OFFSET_S}          # the motor's clock started that much later
column = 2
scale = -1.0                    # the motor counts towards the sample
offset_mm = {MOTOR_HOME_MM}

[source.z_zero]
touch_rows = [1, 2000]          # magnets far away: the beads lie on the surface
"""


def files() -> dict[str, bytes | dict[str, Any]]:
    """Content of the folder: text as bytes, truth as a dictionary."""
    positions = [FAR_MM, *np.round(magnet_at_mm(FORCES_PN), 2).tolist()]
    magnets = staircase(positions, [TOUCH_FRAMES, *REST_FRAMES], MOVE_FRAMES)
    frames = len(magnets.magnet_mm)
    common = stage_motion(STAGE, CAMERA, frames, _random(0))
    seen = {"ref": tracked(common, REFERENCE_NOISE_NM, _random(1))}
    truth: dict[str, Any] = {}
    for number, (name, bead) in enumerate(BEADS.items(), start=2):
        random = _random(number)
        own = bead.force_ratio * force_at_pN(magnets.magnet_mm)
        seen[name] = tracked(_motion(bead, own, magnets, random) + common, NOISE_NM, random)
        forces = [float(own[rest.start]) for rest in magnets.rests[1:]]
        truth[name] = truth_of("one tether", bead, forces, FLUID)
    random = _random(5)
    lost = {name: bursts(6, 5, frames, random) for name in seen}
    return {
        "setup.toml": SETUP.encode(),
        RECORDING: _tracker_text(seen, lost, ~bursts(5, 4, frames, random)),
        LOG: _motor_text(magnets.magnet_mm, _random(6)),
        "truth.json": truth,
    }


def _motion(
    bead: Tethered, force_pN: FloatArray, magnets: Staircase, random: np.random.Generator
) -> FloatArray:
    """First on the surface, then, as the magnets come, on the tether."""
    _, *others = magnets.segments
    parts = [resting_trace(bead, WEIGHT_PN, FLUID, CAMERA, TOUCH_FRAMES, random)]
    for segment in others:
        lifted = np.maximum(force_pN[segment], 0.02)
        parts.append(tethered_trace(bead, lifted, FLUID, CAMERA, random))
    return np.concatenate(parts)


def _tracker_text(
    seen: dict[str, FloatArray], lost: dict[str, np.ndarray], kept: np.ndarray
) -> bytes:
    places = np.round(_random(7).uniform(80, 900, size=(len(seen), 2)), 1) * PIXEL_NM
    columns, missing = [], []
    for (name, position), place in zip(seen.items(), places, strict=True):
        z_um = (position[:, 2] + SURFACE_NM[name]) / REFRACTION / 1000
        columns += [*((position[:, :2] + place) / PIXEL_NM).T, z_um]
        missing += 3 * [lost[name]]
    lines = []
    for frame in np.flatnonzero(kept):
        cells = (
            "-1.#IND000" if gone[frame] else f"{column[frame]:.4f}"
            for column, gone in zip(columns, missing, strict=True)
        )
        lines.append("\t".join([str(FIRST_FRAME + frame), *cells]))
    return ("\n".join(lines) + "\n").encode()


def _motor_text(magnet_mm: FloatArray, random: np.random.Generator) -> bytes:
    """The motor's log, which begins before the recording and ends after it."""
    camera_s = (FIRST_FRAME + np.arange(len(magnet_mm))) * CAMERA.frame_s
    clock_s = np.arange(camera_s[0] - 4, camera_s[-1] + 3, LOG_STEP_S)
    clock_s += random.uniform(0, 0.004, size=len(clock_s))
    motor_mm = MOTOR_HOME_MM - np.interp(clock_s, camera_s, magnet_mm)
    motor_mm += MOTOR_NOISE_MM * random.normal(size=len(clock_s))
    rows = zip((clock_s - CLOCK_OFFSET_S) * 1000, motor_mm, strict=True)
    return "".join(f"{ms:.0f}\t{motor:.4f}\t0.00\n" for ms, motor in rows).encode()


def _random(stream: int) -> np.random.Generator:
    return np.random.default_rng([SEED, stream])
