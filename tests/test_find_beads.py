"""Beads are found where they are drawn, and refused for what is wrong with them."""

from pathlib import Path

import numpy as np
import pytest

from mtpipe.ground.errors import RecordingError
from mtpipe.tracking.find_beads import find_beads, in_reading_order
from tests.stack_images import draw

pytestmark = pytest.mark.slow

RECORDINGS = Path(__file__).parents[1].parent / "shared" / "recordings"
PLACES = [(150.3, 40.2), (40.0, 45.6), (60.7, 120.0), (200.5, 130.5)]


def film(places, frames=8, motion=0.0, shape=(180, 250), seed=0, **options):
    random = np.random.default_rng(seed)
    away = motion * random.normal(size=(len(places), 2, frames))
    beads = [
        (x + dx, y + dy, 100.0 * k)
        for k, ((x, y), (dx, dy)) in enumerate(zip(places, away, strict=True))
    ]
    return draw(shape, beads, seed=seed, **options)


def test_beads_are_found_and_named_in_reading_order():
    found = find_beads(film(PLACES))
    assert [r.name for r in found.regions] == ["bead1", "bead2", "bead3", "bead4"]
    places = [(r.x_px, r.y_px) for r in found.regions]
    assert np.allclose(places, [PLACES[k] for k in (1, 0, 2, 3)], atol=1.0)
    assert not found.refused
    # exp(-(r/8)²) leaves 5 % of the rings' gradient energy beyond r = 10 or so
    assert 8 < found.radius_px < 16
    assert all(r.size_px >= 3 * found.radius_px for r in found.regions)


@pytest.mark.parametrize("motion", [0.5, 3.0])
def test_moving_beads_are_found_about_their_mean(motion):
    found = find_beads(film(PLACES, frames=30, motion=motion))
    for x, y in PLACES:
        assert min(np.hypot(r.x_px - x, r.y_px - y) for r in found.regions) < 1 + 3 * motion
    assert len(found.regions) == 4


def test_faint_beads_in_noise_and_flicker():
    frames = film(PLACES, frames=20, level=20.0, noise=4.0, dtype=np.uint16).astype(float)
    frames *= np.random.default_rng(3).uniform(0.8, 1.2, (20, 1, 1))
    assert len(find_beads(frames).regions) == 4


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_found_in_noise_and_uneven_light(seed):
    random = np.random.default_rng(seed)
    light = 100 + 50 * np.sin(np.arange(300) / 40) + np.arange(200)[:, None]
    for frames in (
        random.poisson(light, (10, 200, 300)),
        100 + 5 * random.normal(size=(2, 200, 300)),
        np.full((3, 64, 64), 7),
    ):
        with pytest.raises(RecordingError, match="no bead was found"):
            find_beads(frames.astype(float))


def test_frames_with_pixels_that_are_no_numbers_are_left_out():
    frames = film(PLACES).astype(float)
    frames[0], frames[2, 5, 5] = np.nan, np.inf
    assert len(find_beads(frames).regions) == 4
    frames[:, 5, 5] = np.nan
    with pytest.raises(RecordingError, match="no numbers"):
        find_beads(frames)


def test_images_without_room_for_a_bead():
    with pytest.raises(RecordingError, match="have 300 x 1 pixels, and a bead takes 16 x 16"):
        find_beads(np.ones((3, 1, 300)))


def test_overlapping_and_cut_beads_are_refused_by_place_and_reason():
    found = find_beads(film([(60, 60), (78, 60), (170, 90), (245, 120), (120, 173)]))
    assert [(round(r.x_px), round(r.y_px)) for r in found.regions] == [(170, 90)]
    reasons = {(round(r.x_px, -1), round(r.y_px, -1)): r.reason for r in found.refused}
    assert "overlaps with the bead at x = 78, y = 60" in reasons[60, 60]
    assert "overlaps with the bead at x = 60, y = 60" in reasons[80, 60]
    assert reasons[240, 120] == reasons[120, 170] == "is cut by the border of the image"


def test_a_scratch_through_the_rings_is_another_pattern():
    frames = film([(60, 60), (170, 90)])
    frames[:, 66:68, 40:90] = 255
    found = find_beads(frames)
    assert [(round(r.x_px), round(r.y_px)) for r in found.regions] == [(170, 90)]


def test_specks_are_no_beads():
    frames = film(PLACES).astype(float)
    y, x = np.mgrid[:180, :250]
    for sx, sy in ((20, 160), (120, 90), (230, 30)):
        frames += 40 * np.exp(-((x - sx) ** 2 + (y - sy) ** 2) / 4)
    found = find_beads(frames)
    assert len(found.regions) == 4
    assert found.fainter == 3


def test_a_region_is_as_large_as_told_or_as_fits():
    one = film([(13.0, 90.0), (150.0, 90.0)])
    found = find_beads(one)
    near, far = found.regions
    assert near.size_px == 27
    assert far.size_px == 2 * np.ceil(1.5 * found.radius_px) + 1 > near.size_px
    told = find_beads(one, size_px=41)
    assert [r.size_px for r in told.regions] == [41]
    assert told.refused[0].reason == "is cut by the border of the image"


def test_reading_order_takes_lines_with_their_raggedness():
    places = [(50.0, 12.0), (10.0, 14.0), (90.0, 9.0), (5.0, 40.0), (60.0, 36.0)]
    assert in_reading_order(places, 10.0) == [places[k] for k in (1, 0, 2, 3, 4)]


def test_a_hundred_real_beads():
    """The microscope frame of qtrk: about 65 beads stand alone, as counted by eye."""
    path = RECORDINGS / "qtrk-images" / "q_cputrack-test_00008153.jpg"
    if not path.exists():
        pytest.skip("the recordings of ../shared are not here")
    import imagecodecs

    image = imagecodecs.imread(str(path)).astype(float)
    found = find_beads(image[None] + np.random.default_rng(0).normal(size=(4, *image.shape)))
    assert 58 <= len(found.regions) <= 68
    assert 15 <= len(found.refused) <= 35
    assert any("overlaps" in r.reason for r in found.refused)
    assert any("border" in r.reason for r in found.refused)


def test_a_real_bead_through_its_focus_scan():
    path = RECORDINGS / "vannoort-stacks" / "data_024ROI.bin"
    if not path.exists():
        pytest.skip("the recordings of ../shared are not here")
    frames = np.fromfile(path, np.uint8).reshape(-1, 100, 100)
    (region,) = find_beads(frames[::5].astype(float)).regions
    assert abs(region.x_px - 49) < 3
    assert abs(region.y_px - 50) < 3
