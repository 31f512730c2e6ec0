"""Noise that a fit shows, compared with the noise that the images explain."""

import dataclasses
import math

import pytest

import mtpipe
from mtpipe.calibration.noise_floor import noise_floor_nm, noise_notices
from mtpipe.pipeline.tables import beads_table
from mtpipe.pipeline.verdict import BeadVerdict
from mtpipe.recording.recording import Tracked
from mtpipe.setup.setup import parse_setup
from tests.simulated import setup_content

NOISE_NM = (20.0, 20.0, 20.0)


@pytest.fixture(scope="module")
def recording():
    setup = parse_setup(setup_content())
    made = mtpipe.simulate(setup, [0.5, 2.0], 4096, seed=3, noise_nm=NOISE_NM)
    return mtpipe.subtract_drift(made)


@pytest.fixture(scope="module")
def calibration(recording):
    return mtpipe.calibrate(recording)


def tracked(recording, *precision):
    return dataclasses.replace(recording, tracked=Tracked({"b1": precision}, frozenset()))


def told(calibration, recording):
    (bead,) = calibration.beads
    return {n.axis: n.severity for n in noise_notices(bead, recording)}


def test_the_floor_is_the_noise_there_is(calibration):
    (bead,) = calibration.beads
    assert bead.series
    for axis in "xy":
        floor = noise_floor_nm(bead, axis)
        assert abs(floor.value - NOISE_NM[0]) < 4 * floor.stderr
        # the joint fit has one noise for all plateaus
        assert floor in [one.estimates.noise for one in bead.plateaus[0].axes]


def test_without_a_joint_fit_the_median_of_identified_plateaus(calibration):
    (bead,) = calibration.beads
    low, high = (plateau.axes[2].estimates.noise for plateau in bead.plateaus)
    assert noise_floor_nm(bead, "z").value == pytest.approx((low.value + high.value) / 2)
    first, second = bead.plateaus
    refused = dataclasses.replace(first.axes[2], refusal="stuck")
    first = dataclasses.replace(first, axes=(*first.axes[:2], refused))
    one = dataclasses.replace(bead, plateaus=(first, second))
    assert noise_floor_nm(one, "z").value == high.value
    assert noise_floor_nm(dataclasses.replace(bead, plateaus=()), "x") is None


def test_what_the_bead_s_motion_hides_is_not_a_floor(recording):
    quiet = mtpipe.simulate(recording.setup, [0.5], 2048, seed=3, noise_nm=(0.5, 0.5, 0.5))
    (bead,) = mtpipe.calibrate(mtpipe.subtract_drift(quiet)).beads
    # the fit's noise is that of the reference bead, to a factor 2
    assert bead.plateaus[0].axes[0].estimates.noise.value < 2
    assert noise_floor_nm(bead, "x") is None


def test_noise_that_the_images_explain_is_not_told(calibration, recording):
    assert told(calibration, tracked(recording, *NOISE_NM)) == {}
    assert told(calibration, tracked(recording, math.nan, math.nan, math.nan)) == {}
    assert told(calibration, recording) == {}


def test_noise_beyond_that_is(calibration, recording):
    (bead,) = calibration.beads
    z_too = {"x": "caution", "y": "caution", "z": "info"}
    assert told(calibration, tracked(recording, 5.0, 5.0, 5.0)) == z_too
    assert told(calibration, tracked(recording, 5.0, *NOISE_NM[1:])) == {"x": "caution"}
    (said,) = noise_notices(bead, tracked(recording, 5.0, *NOISE_NM[1:]))
    assert "light and camera make 5 nm" in said.message
    # within three standard errors of 1.5 times as much
    floor = noise_floor_nm(bead, "x")
    for sigmas, codes in ((2.5, set()), (3.5, {"x"})):
        explained = (floor.value - sigmas * floor.stderr) / 1.5
        assert set(told(calibration, tracked(recording, explained, *NOISE_NM[1:]))) == codes


def test_reference_noise_subtracted_frame_by_frame_is_expected(calibration, recording):
    one = tracked(recording, 8.0, 8.0, NOISE_NM[2])
    assert set(told(calibration, one)) == {"x", "y"}
    added = dataclasses.replace(
        one.drift, cutoff_hz=(None, 1.0, 1.0), noise_added_nm=(18.0, 18.0, 18.0)
    )
    assert set(told(calibration, dataclasses.replace(one, drift=added))) == {"y"}


def test_the_table_of_beads_has_both(calibration, recording):
    verdict = BeadVerdict("b1", "good", ())
    one = tracked(recording, 1.0, 2.0, math.nan)
    forces = calibration.forces
    (row,) = beads_table(calibration, forces, [verdict], {}, one.tracked).to_dict("records")
    assert row["noise_floor_x_nm"] == noise_floor_nm(calibration.beads[0], "x").value
    assert row["image_precision_y_nm"] == 2.0
    assert math.isnan(row["image_precision_z_nm"])
    (row,) = beads_table(calibration, forces, [verdict], {}, None).to_dict("records")
    assert math.isnan(row["image_precision_x_nm"])
    assert row["noise_floor_z_stderr_nm"] > 0
