"""From image to force: rendered stacks of two tethered beads and a reference, tracked and fitted.

The stacks go through the same steps as a laboratory's: `mtpipe.tracking.track.track` with a
look-up table from a rendered scan, then the recording it wrote through drift subtraction and
calibration. Beside them stands the same calibration of the truth with white noise of the tracked
positions' size: what differs is what tracking does beyond white noise.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from accuracy import rms
from pages import table

import mtpipe
from mtpipe.calibration.bead_results import BeadResult
from mtpipe.recording.recording import Recording
from mtpipe.simulation.bead_image import BeadImage
from mtpipe.simulation.images import Sensor, draw, optics_of, render_stack
from mtpipe.tracking.lookup_table import LookUpTable
from mtpipe.tracking.track import track

FORCES_PN = (0.5, 2.0, 8.0)
SIZE_PX = 64
SETUP = """\
schema = 1
[camera]
frame_rate_hz = 120.0
exposure_s = 0.0083333333
pixel_size_nm = 100.0
[beads]
radius_nm = 1400.0
radius_nm_stderr = 30.0
reference = ["ref1"]
[tether]
contour_length_nm = 2700.0
persistence_length_nm = 50.0
[buffer]
temperature_K = 298.15
viscosity_mPa_s = 0.89
[field]
direction = "x"
[model]
effects = ["wall_drag", "rotation_coupling", "tracking_noise"]
[source]
z_zero = { value_nm = 0.0 }
"""


@dataclass(frozen=True)
class Stack:
    """One rendered stack with what became of it."""

    force_pN: float
    truth: Recording
    tracked: Recording
    render_s: float
    track_s: float


def forces_table(frames: int, seed: int) -> str:
    """A row per bead and force."""
    lines, seconds = [], []
    with tempfile.TemporaryDirectory(prefix="mtpipe-study-") as name:
        folder = Path(name)
        (folder / "setup.toml").write_text(SETUP, encoding="utf-8")
        _scan(folder)
        for i, force in enumerate(FORCES_PN):
            stack = _tracked(folder, force, frames, seed + i)
            seconds.append((stack.render_s, stack.track_s))
            lines += _rows(stack)
    render, tracking = np.mean(seconds, axis=0)
    return (
        table(
            "force (pN) | bead | rms error x, y, z (nm) | lost frames | force tracked (pN)"
            " | off by (standard errors) | force from the truth with white noise (pN)",
            lines,
        )
        + f"\n\nA stack of {frames} frames takes {render:.0f} s of CPU time to render and "
        f"{tracking:.0f} s to track and load, three beads each."
    )


def _scan(folder: Path) -> None:
    setup = mtpipe.read_setup(folder / "setup.toml")
    heights = np.repeat(np.arange(-300.0, 2901.0, 50.0), 8)
    random = np.random.default_rng(1)
    xy = (SIZE_PX - 1) / 2 + random.uniform(-0.5, 0.5, (len(heights), 2))
    image = BeadImage.of(optics_of(setup), heights[0], heights[-1])
    stack = draw(image, Sensor(), np.column_stack([xy, heights]), (SIZE_PX, SIZE_PX), random)
    LookUpTable.build(
        stack,
        heights,
        bead="scan",
        refractive_index_factor=1.0,
        pixel_size_nm=100.0,
        stack="rendered scan",
    ).save(folder / "lut.npz")


def _tracked(folder: Path, force_pN: float, frames: int, seed: int) -> Stack:
    setup = mtpipe.read_setup(folder / "setup.toml")
    path, began = folder / "stack.tif", time.process_time()
    truth = render_stack(path, setup, [force_pN], frames, seed, beads=2)
    rendered = time.process_time()
    regions = "".join(
        f'[[tracking.regions]]\nname = "{name}"\nx_px = {xyz[0, 0] / 100:.0f}\n'
        f"y_px = {xyz[0, 1] / 100:.0f}\nsize_px = {SIZE_PX}\n"
        for name, xyz in truth.positions_nm.items()
    )
    stated = folder / "tracking.toml"
    stated.write_text(f'{SETUP}[tracking]\nlook_up_table = "lut.npz"\n{regions}', encoding="utf-8")
    track(path, folder / "recording.csv", setup=stated)
    recording = mtpipe.load(folder / "recording.csv", setup=stated)
    return Stack(force_pN, truth, recording, rendered - began, time.process_time() - rendered)


def _rows(stack: Stack) -> list[list[str]]:
    from_images, from_truth = (
        {bead.bead: bead for bead in mtpipe.calibrate(mtpipe.subtract_drift(r)).beads}
        for r in (stack.tracked, _with_noise(stack))
    )
    rows = []
    for name, truth in stack.truth.positions_nm.items():
        found = stack.tracked.positions_nm[name]
        errors = ", ".join(f"{rms(column):.2f}" for column in (found - truth).T)
        row = [f"{stack.force_pN:g}", name, errors, f"{int(np.isnan(found[:, 0]).sum())}"]
        if name in from_images:
            value, stderr = _force(from_images[name])
            off = (value - stack.force_pN) / stderr
            alone = _force(from_truth[name])
            row += [f"{value:.3f} ± {stderr:.3f}", f"{off:+.1f}", "{:.3f} ± {:.3f}".format(*alone)]
        else:
            row += ["reference", "", ""]
        rows.append(row)
    return rows


def _with_noise(stack: Stack) -> Recording:
    """The truth with white noise as large as the errors of tracking."""
    random = np.random.default_rng(0)
    noisy = {
        name: xyz
        + np.nanstd(stack.tracked.positions_nm[name] - xyz, axis=0) * random.normal(size=xyz.shape)
        for name, xyz in stack.truth.positions_nm.items()
    }
    return replace(stack.truth, positions_nm=noisy)


def _force(bead: BeadResult) -> tuple[float, float]:
    force = bead.plateaus[0].axes[0].force
    return (np.nan, np.nan) if force is None else (force.value, force.stderr)
