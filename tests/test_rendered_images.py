"""Rendered stacks: what is in them, and from image to force against the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import tifffile

import mtpipe
from mtpipe.ground.errors import SetupError
from mtpipe.physics.camera import Camera
from mtpipe.simulation.bead_image import BeadImage, BeadOptics
from mtpipe.simulation.images import Sensor, optics_of, parts_of, render_stack
from mtpipe.tracking.library import optics
from tests import rendered

pytestmark = pytest.mark.slow

SETUP = f"{rendered.SETUP}[source]\nz_zero = {{ value_nm = 0.0 }}\n"


def alone(image, x, y, z, size=90):
    frame = np.ones((1, size, size))
    image.add_to(frame, *(np.full((1, 1), v, dtype=float) for v in (x, y, z)))
    return frame[0]


@pytest.mark.parametrize("z_nm", [333.0, 1002.5])
def test_a_bead_is_drawn_as_the_optical_model_draws_it(z_nm):
    """With the model's pixels a third as large, as the module says, at a place between them.

    The model repeats its image on all sides; far enough away, here, for that not to matter.
    """
    shift_nm = np.array([37.0, -81.0])
    model = optics().simulate_beads(
        np.array([[*shift_nm, z_nm + BeadOptics(1400.0, 100.0).focus_nm]]),
        nm_per_px=100.0 / 3,
        size_px=312,
        radius_nm=1400.0,
        background_level=0.02,
        pad_factor=4.0,
    )[:, :, 0]
    pixels = model[1:-2, 1:-2].reshape(103, 3, 103, 3).mean(axis=(1, 3))
    # pixel k of these is centred at 3 k + 2 of the model's, whose bead is at 156
    place = (156 - 2) / 3 + shift_nm / 100.0
    drawn = alone(rendered.bead(), *place, z_nm, size=103)
    row, column = np.indices(drawn.shape)
    near = np.hypot(column - place[0], row - place[1]) < 35
    error = drawn[near] / drawn[near].mean() - pixels[near] / pixels[near].mean()
    assert np.std(error) < 0.012
    assert np.abs(error).max() < 0.04
    assert np.std(drawn[near]) > 0.3


def test_motion_within_a_frame_blurs_the_image():
    image, path = rendered.bead(), np.linspace(40, 46, 7)
    frame = np.ones((1, 90, 90))
    image.add_to(frame, path[None], np.full((1, 7), 44.0), np.full((1, 7), 500.0))
    expected = np.mean([alone(image, x, 44.0, 500.0) for x in path], axis=0)
    np.testing.assert_allclose(frame[0], expected, rtol=1e-12)
    assert np.abs(frame[0] - alone(image, path.mean(), 44.0, 500.0)).max() > 0.1


def test_two_beads_add_to_the_background():
    image, frame = rendered.bead(), np.ones((1, 90, 90))
    for x in (30.0, 60.0):
        image.add_to(frame, *(np.full((1, 1), v) for v in (x, 44.0, 500.0)))
    expected = alone(image, 30.0, 44.0, 500.0) + alone(image, 60.0, 44.0, 500.0) - 1
    np.testing.assert_allclose(frame[0], expected)


@pytest.mark.parametrize("bits", [8, 16])
def test_a_sensor_counts_photoelectrons(bits):
    sensor = Sensor(2000.0, 30.0, 20.0, 5.0, bits, flicker=0.0, response_spread=0.0)
    levels = sensor.expose(
        np.ones((50, 40, 40)), np.ones((40, 40)), np.random.default_rng(0)
    ).astype(float)
    assert levels.mean() == pytest.approx(2000 / 20 + 5, abs=0.05)
    assert levels.var() == pytest.approx((2000 + 30**2) / 20**2 + 1 / 12, rel=0.02)


def test_lamp_flickers_frame_by_frame_and_response_stays():
    sensor = replace(Sensor(background_e=1e6, bits=16), flicker=0.02, response_spread=0.05)
    random = np.random.default_rng(0)
    response = sensor.response((40, 40), random)
    levels = sensor.expose(np.ones((200, 40, 40)), response, random).astype(float)
    by_frame, by_pixel = levels.mean(axis=(1, 2)), levels.mean(axis=0)
    assert np.std(by_frame) / by_frame.mean() == pytest.approx(0.02, rel=0.2)
    assert np.corrcoef(by_pixel.ravel(), response.ravel())[0, 1] > 0.99


def test_levels_saturate():
    random = np.random.default_rng(0)
    levels = Sensor().expose(np.full((1, 4, 4), 100.0), np.ones((4, 4)), random)
    assert (levels == 255).all()
    assert levels.dtype == np.uint8


@pytest.mark.parametrize(
    ("share", "parts"), [(1.0, (4, 4)), (0.5, (4, 2)), (0.1, (10, 1)), (0.6, (5, 3))]
)
def test_a_frame_has_a_whole_number_of_open_parts(share, parts):
    assert parts_of(Camera(0.01, 0.01 * share)) == parts


def test_an_odd_exposure_cannot_be_rendered():
    with pytest.raises(SetupError, match=r"0\.0123 of a frame"):
        parts_of(Camera(0.01, 0.000123))


def test_setups_that_cannot_be_drawn():
    setup = rendered.setup()
    blind = setup.model_copy(
        update={"camera": setup.camera.model_copy(update={"pixel_size_nm": None})}
    )
    with pytest.raises(SetupError, match="pixel_size_nm"):
        optics_of(blind)


def test_a_stack_has_its_frames_times_and_magnets(tmp_path):
    truth = render_stack(tmp_path / "a.tif", rendered.setup(), [3.0, 4.0], 20, 3)
    again = render_stack(tmp_path / "b.tif", rendered.setup(), [3.0, 4.0], 20, 3)
    other = render_stack(tmp_path / "c.tif", rendered.setup(), [3.0, 4.0], 20, 4)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert len(file.pages) == len(truth.time_s)
        assert file.imagej_metadata["finterval"] == pytest.approx(1 / 120)
        levels = file.asarray()
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "b.tif"), levels)
    np.testing.assert_array_equal(again.positions_nm["b1"], truth.positions_nm["b1"])
    assert not np.array_equal(other.positions_nm["b1"], truth.positions_nm["b1"])
    rows = np.loadtxt(tmp_path / "a-magnets.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(rows[:, 0], np.arange(len(levels)))
    np.testing.assert_allclose(rows[:, 1], truth.magnet_mm, atol=1e-6)
    assert len(np.unique(rows[[0, -1], 1])) == 2
    height, width = levels.shape[1:]
    for xyz in truth.positions_nm.values():
        assert (xyz[:, :2] > 0).all()
        assert (xyz[:, 0] < 100 * width).all()
        assert (xyz[:, 1] < 100 * height).all()


@pytest.mark.parametrize("exposure_s", [1 / 120, 1 / 240])
def test_the_truth_is_the_mean_over_the_exposure(tmp_path, exposure_s):
    """Blur takes as much of the variance as the setup's exposure says, no more and no less."""
    setup = rendered.setup(exposure_s)
    drawn = render_stack(
        tmp_path / "s.tif", setup, [5.0], 1200, 1, optics=BeadOptics(1400.0, 100.0, reach_px=2)
    )
    simulated = mtpipe.simulate(setup, [5.0], 40_000, 2, noise_nm=(0.0, 0.0, 0.0))
    for axis in (0, 1):
        # differences between frames leave the stage's drift out
        ratio = np.var(np.diff(drawn.positions_nm["b1"][:, axis])) / np.var(
            np.diff(simulated.positions_nm["b1"][:, axis])
        )
        assert ratio == pytest.approx(1, abs=0.15)


def test_from_image_to_force(tmp_path):
    """Two tethered beads and a reference, tracked by the pipeline, against the truth."""
    from mtpipe.tracking.track import track

    force_pN = 2.0
    (tmp_path / "setup.toml").write_text(SETUP)
    truth = render_stack(
        tmp_path / "stack.tif",
        mtpipe.read_setup(tmp_path / "setup.toml"),
        [force_pN],
        1000,
        11,
        beads=2,
    )
    scan = BeadImage.of(optics_of(rendered.setup()), -200.0, 1100.0)
    table = rendered.build(*rendered.scan(image=scan, low_nm=-200.0, high_nm=1100.0))
    table.save(tmp_path / "lut.npz")
    regions = "".join(
        f'[[tracking.regions]]\nname = "{name}"\nx_px = {xyz[0, 0] / 100:.0f}\n'
        f"y_px = {xyz[0, 1] / 100:.0f}\nsize_px = {rendered.SIZE_PX}\n"
        for name, xyz in truth.positions_nm.items()
    )
    (tmp_path / "setup.toml").write_text(
        f'{SETUP}\n[tracking]\nlook_up_table = "lut.npz"\n{regions}'
    )
    track(tmp_path / "stack.tif", tmp_path / "recording.csv", setup=tmp_path / "setup.toml")
    recording = mtpipe.load(tmp_path / "recording.csv", setup=tmp_path / "setup.toml")
    for name, expected in truth.positions_nm.items():
        found = recording.positions_nm[name]
        assert np.isfinite(found).all()
        rms = np.sqrt(np.mean((found - expected) ** 2, axis=0))
        assert (rms < [1.5, 1.5, 3.0]).all(), (name, rms)
    calibration = mtpipe.calibrate(mtpipe.subtract_drift(recording))
    for bead in calibration.beads:
        for axis in bead.plateaus[0].axes[:2]:
            force = axis.force
            assert abs(force.value - force_pN) < 3 * force.stderr
            assert force.stderr < 0.2 * force_pN
