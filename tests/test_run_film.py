"""The main job from a film: a folder of images with the magnets' log in, forces out."""

import json

import numpy as np
import pandas as pd
import pytest

import mtpipe
from mtpipe.calibration.free_fits import NOISE_FACTOR
from mtpipe.pipeline.demo_film import FORCES_PN, film_run

pytestmark = pytest.mark.slow

# in reading order, and as they were simulated
SIMULATED = {"bead1": "bead1", "bead2": "b1"}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("film")
    truth, run = film_run(folder)
    return truth, run, folder / "run"


def test_the_film_is_tracked_into_the_run_folder(finished):
    truth, _, out = finished
    tracked = mtpipe.load(out / "recording.csv", out.parent / "setup.toml")
    assert tracked.tethered == ("bead2",)
    for bead, name in SIMULATED.items():
        error = tracked.positions_nm[bead] - truth.positions_nm[name]
        rms = np.sqrt(np.mean(error**2, axis=0))
        assert (rms[:2] < 3).all()
        # z = 0 as the setup has it is the tethered beads'
        assert bead == "bead1" or rms[2] < 8
    told = json.loads((out / "run.json").read_text())
    assert "track" in told["seconds"]
    assert "beads_found" in [n["code"] for n in told["notices"]]


def test_forces_are_true(finished):
    _, _, out = finished
    forces = pd.read_csv(out / "forces.csv")
    for axis in "xy":
        mine = forces[forces.axis == axis]
        assert list(mine.plateau) == [0, 1]
        assert np.isfinite(mine.force_pN).all()
        assert (np.abs(mine.force_pN - np.array(FORCES_PN)) < 4 * mine.force_stderr_pN).all()
        assert (mine.force_stderr_pN < 0.25 * np.array(FORCES_PN)).all()


def test_the_noise_expected_is_the_reference_beads_scaled_by_the_images(finished):
    _, run, _ = finished
    precision = run.recording.tracked.precision_nm
    (reference,) = run.recording.drift.references
    for plateau in run.calibration.beads[0].plateaus:
        for i, one in enumerate(plateau.axes):
            scaled = reference.noise_nm[i] * precision["bead2"][i] / precision["bead1"][i]
            assert one.free.model.noise_prior_nm == pytest.approx((scaled, NOISE_FACTOR))
            assert scaled != pytest.approx(reference.noise_nm[i], rel=1e-3)


def test_noise_by_images_is_stated_and_what_motion_hides_is_not(finished):
    _, run, out = finished
    (bead,) = pd.read_csv(out / "beads.csv").to_dict("records")
    for i, axis in enumerate("xyz"):
        assert bead[f"image_precision_{axis}_nm"] == run.recording.tracked.precision_nm["bead2"][i]
        # at 120 Hz the bead's own motion is far above this noise, at every frequency
        assert np.isnan(bead[f"noise_floor_{axis}_nm"])
    assert "noise_above_images" not in [n.code for n in run.notices]
    page = (out / "report" / "bead-bead2.html").read_text(encoding="utf-8")
    assert "nm by its images, not determined by its spectra" in page
