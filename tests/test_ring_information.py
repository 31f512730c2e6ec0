"""What rings tell of a bead's place, against the image that was drawn and the tracker itself."""

import functools
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from mtpipe.ground.errors import RecordingError
from mtpipe.simulation.bead_image import FINE_PX, BeadImage, BeadOptics
from mtpipe.simulation.images import Sensor, draw
from mtpipe.tracking.find_beads import Region, find_beads
from mtpipe.tracking.follow import corner
from mtpipe.tracking.positions import locate
from mtpipe.tracking.precision import pixel_noise
from mtpipe.tracking.region_sizes import sized
from mtpipe.tracking.regions import BESIDE, check_inside, said_of
from mtpipe.tracking.ring_information import RingInformation

SENSOR = Sensor(background_e=2000.0, bits=16, electrons_per_level=0.5, offset=0.0, flicker=0.0)
HEIGHT_NM = 100.0


@functools.cache
def bead():
    return BeadImage.of(BeadOptics(500.0, 100.0, 3000.0, reach_px=70), 0.0, 200.0)


def pictures(places, shape=(201, 201), seed=0):
    places = np.asarray(places, dtype=float)
    xyz = np.column_stack([places, np.full(len(places), HEIGHT_NM)])
    return draw(bead(), SENSOR, xyz, shape, np.random.default_rng(seed))


def anywhere(count, middle, seed=0):
    return middle + np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 2))


@functools.cache
def rings():
    places = anywhere(12, 100)
    stack = pictures(places)
    return RingInformation.of(stack.astype(float), *places.T, pixel_noise(stack))


def information_drawn():
    """Fisher information on x within each radius, px⁻², by the profile that is drawn."""
    plane = np.argmin(np.abs(bead().low_nm + 5.0 * np.arange(len(bead().brightness)) - HEIGHT_NM))
    profile = bead().brightness[plane]
    r = FINE_PX * np.arange(len(profile))
    variance = profile / SENSOR.background_e + (SENSOR.read_noise_e / SENSOR.background_e) ** 2
    return r, np.cumsum(np.pi * r * np.gradient(profile, FINE_PX) ** 2 / variance) * FINE_PX


@pytest.mark.slow
def test_information_by_ring_is_that_of_the_image_drawn_and_ends_with_its_rings():
    r, drawn = information_drawn()
    grown = np.cumsum(rings().by_ring.mean(axis=0))
    for radius in (10, 20, 30, 45, 60):
        expected = np.interp(radius, r, drawn)
        # slopes over a pixel are smaller than those at a point
        assert 0.7 < np.interp(radius, rings().radii_px, grown) / expected < 1.02
    assert np.all(np.diff(grown) > -0.005 * grown[-1])
    assert abs(grown[-1] - np.interp(75, rings().radii_px, grown)) < 0.01 * grown[-1]


@pytest.mark.slow
def test_precision_expected_of_a_size_is_the_scatter_of_the_tracker():
    stack = pictures(np.tile([100.2, 99.7], (250, 1)), seed=1)
    for size in (41, 81, 141):
        first = 100 - size // 2
        found = locate(stack[:, first : first + size, first : first + size])
        scatter = np.sqrt(np.mean([np.var(found.x_px), np.var(found.y_px)]))
        # the scatter is known to 3 %
        assert rings().precision_px(size) == pytest.approx(scatter, rel=0.15)


def test_a_larger_region_is_not_better_and_a_smaller_one_is():
    size = rings().size_px()
    best = min(rings().precision_px(s) for s in range(17, 200, 2))
    assert rings().precision_px(size) <= 1.02 * best
    assert rings().precision_px(size - 2) > 1.02 * best
    assert rings().share(41) < rings().share(81) < rings().share(size) < 1


def test_noise_and_dust_tell_nothing():
    random = np.random.default_rng(2)
    places = anywhere(12, 60)
    speck = 400 * np.exp(-((np.mgrid[:121, :121] - 85) ** 2).sum(axis=0) / 8)
    tilt = np.arange(121)[None, :] * 3.0
    for still in (0.0, speck, tilt):
        stack = random.poisson(2000 + np.zeros((12, 121, 121)) + still).astype(float)
        none = RingInformation.of(stack, *places.T, pixel_noise(stack))
        assert abs(none.by_ring.sum()) < 0.01 * rings().by_ring.sum()


def film(places, shape=(240, 360), motion_px=0.0):
    random = np.random.default_rng(3)
    brightness = np.ones((40, *shape))
    for x, y in places:
        away = motion_px * random.normal(size=(2, 40, 1))
        bead().add_to(brightness, x + away[0], y + away[1], np.full((40, 1), HEIGHT_NM))
    return SENSOR.expose(brightness, np.ones(shape), random)


def sizes(frames, size_px=None):
    found, seen = sized(find_beads(frames, size_px=size_px), frames, size_px)
    smallest, largest = (f(r.size_px for r in found.regions) for f in (min, max))
    assert f"{largest} x {largest} pixels; tracking uses" in said_of(found, seen).message
    assert f"{seen.share(smallest):.0%}" in said_of(found, seen).message
    return {(round(r.x_px, -1), round(r.y_px, -1)): r.size_px for r in found.regions}


def test_a_region_is_as_large_as_rings_are_worth():
    (size,) = sizes(film([(180, 120)])).values()
    assert size == pytest.approx(rings().size_px(), abs=6)


def test_a_region_ends_at_the_border_and_halfway_to_the_next_bead():
    found = sizes(film([(40, 120), (200, 120), (270, 120)]))
    assert found[40, 120] == pytest.approx(81, abs=5)
    assert found[200, 120] == found[270, 120] == pytest.approx(71, abs=3)


@pytest.mark.slow
def test_a_bead_that_moves_gets_room():
    still, moving = (
        next(iter(sizes(film([(180, 120)], motion_px=motion)).values())) for motion in (0.0, 3.0)
    )
    # three standard deviations to each side, which forty frames tell to 15 %
    assert 12 <= moving - still <= 26


def test_a_size_that_is_told_stays():
    assert sizes(film([(180, 120)]), 41) == {(180, 120): 41}


@pytest.mark.parametrize(("x_px", "inside"), [(28, True), (22, False)])
def test_a_bead_nearer_to_the_border_than_its_table_asks_is_taken_a_little_off_the_middle(
    x_px, inside
):
    image = SimpleNamespace(width=200, height=200, name="film.tif")
    region = Region("b", x_px, 100, 65)
    with pytest.raises(RecordingError, match="cut by the border"):
        check_inside(region, image)
    with nullcontext() if inside else pytest.raises(RecordingError, match="cut by the border"):
        check_inside(region, image, beside=BESIDE)
    _, column = corner(region, (200, 200))
    assert (abs(x_px - (column + 32)) < 65 / 8) is inside
