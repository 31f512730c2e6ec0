"""The demo from images: a film and a focus scan are rendered, a look-up table made, the film run.

A tethered bead and one fixed to the surface, as a camera of 100 nm pixels sees them. The scan's
stage has its zero 300 nm below the surface, as any stage has it somewhere.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import tifffile

from mtpipe.ground.types import NamedProgress
from mtpipe.pipeline.results import Run
from mtpipe.pipeline.run import run
from mtpipe.proposal.questions import USUAL_EFFECTS
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import read_setup
from mtpipe.simulation.bead_image import BeadImage
from mtpipe.simulation.images import Sensor, draw, optics_of, render_stack
from mtpipe.tracking.scan import table_from_scan

FORCES_PN, FRAMES = (1.0, 5.0), 900
TABLE_ZERO_NM = 300.0
LOW_NM, HIGH_NM, STEP_NM, REPEATS = -100.0, 1100.0, 50.0, 5
SIZE_PX = 64
SETUP = f"""\
schema = 1

[camera]
frame_rate_hz = 120.0
exposure_s = 0.008333333
pixel_size_nm = 100.0

[beads]
radius_nm = 1400.0
reference = ["bead1"]

[tether]
contour_length_nm = 1000.0
persistence_length_nm = 50.0

[buffer]
temperature_K = 298.15
viscosity_mPa_s = 0.89

[field]
direction = "x"

[model]
effects = {json.dumps(USUAL_EFFECTS)}

[source]
z_zero.value_nm = {TABLE_ZERO_NM}

[tracking]
look_up_table = "bead.npz"
size_px = {SIZE_PX}

[tracking.magnet]
file = "film-magnets.csv"
column = "magnet_mm"
row_by_row = true
header = true
delimiter = "comma"
"""


def make_film(folder: Path, *, seed: int = 5) -> Recording:
    """Write setup.toml, film.tif with its magnets' log, and the look-up table bead.npz.

    The scan that the table is of is `scan/scan.tif` with `scan/positions.csv`.

    Returns
    -------
    The truth, as `mtpipe.simulation.images.render_stack` has it.
    """
    scan = folder / "scan"
    scan.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(SETUP, encoding="utf-8")
    setup = read_setup(folder / "setup.toml")
    truth = render_stack(folder / "film.tif", setup, FORCES_PN, FRAMES, seed)
    random = np.random.default_rng(seed)
    heights = np.repeat(np.arange(LOW_NM, HIGH_NM + STEP_NM / 2, STEP_NM), REPEATS)
    middle = (SIZE_PX - 1) / 2 + random.uniform(-0.5, 0.5, (len(heights), 2))
    bead = BeadImage.of(optics_of(setup), LOW_NM, HIGH_NM)
    places = np.column_stack([middle, heights])
    images = draw(bead, Sensor(), places, (SIZE_PX, SIZE_PX), random)
    tifffile.imwrite(scan / "scan.tif", images, imagej=True, metadata={"axes": "TYX"})
    rows = "".join(f"{height + TABLE_ZERO_NM:g}\n" for height in heights)
    (scan / "positions.csv").write_text(f"z_nm\n{rows}", encoding="utf-8")
    table = table_from_scan(
        scan / "scan.tif",
        scan / "positions.csv",
        refractive_index_factor=1.0,
        region=((SIZE_PX - 1) / 2, (SIZE_PX - 1) / 2, SIZE_PX),
    )
    table.save(folder / "bead.npz")
    return truth


def film_run(
    out: Path, *, workers: int = 1, progress: NamedProgress | None = None
) -> tuple[Recording, Run]:
    """Render a film in a folder and run it into the folder `run` there: the truth and the run."""
    if progress is not None:
        progress("rendering the film", 0, 1)
    truth = make_film(out)
    film, results = out / "film.tif", out / "run"
    return truth, run(film, results, workers=workers, cross_check=False, progress=progress)


def run_film_demo(out: Path, *, workers: int = 1, progress: NamedProgress | None = None) -> str:
    """Text: the film's true and measured forces, and where the report is."""
    _, result = film_run(out, workers=workers, progress=progress)
    lines = [
        f"{true:g} pN: {value:.3f} ± {stderr:.3f} pN"
        for true, (value, stderr) in zip(FORCES_PN, _forces(result), strict=True)
    ]
    report = out / "run" / "report" / "index.html"
    return "\n".join(["True and measured force of the film's bead:", *lines, f"Report: {report}"])


def _forces(result: Run) -> list[tuple[float, float]]:
    (bead,) = result.calibration.beads
    found = []
    for plateau in bead.plateaus:
        force = next(one.force for one in plateau.axes if one.force is not None)
        found.append((force.value, force.stderr))
    return found
