"""Positions of beads in images: accuracy on rendered ones; what is lost and not invented."""

from __future__ import annotations

import subprocess
import sys
import types
from dataclasses import replace

import numpy as np
import pytest

from mtpipe.ground.errors import RecordingError
from mtpipe.simulation.bead_image import BeadImage, BeadOptics
from mtpipe.simulation.images import Sensor
from mtpipe.tracking.library import magtrack
from mtpipe.tracking.measured import LOST_REASONS, METHODS
from mtpipe.tracking.positions import locate
from tests import rendered

pytestmark = pytest.mark.slow


def reasons(positions) -> set[str]:
    return {LOST_REASONS[code] for code in positions.lost if code}


def errors_nm(found, truth):
    """(n, 3) x, y, z in nm."""
    scale = np.array([rendered.PIXEL_NM, rendered.PIXEL_NM, 1.0])
    return (np.column_stack([found.x_px, found.y_px, found.z_nm]) - truth) * scale


@pytest.mark.parametrize(
    ("method", "lateral_nm", "axial_nm"),
    [("auto_conv", 3.0, 3.0), ("auto_conv_multiline", 1.0, 1.5), ("magtrack", 1.0, 15.0)],
)
def test_positions_are_where_the_bead_was_drawn(method, lateral_nm, axial_nm):
    # magtrack leaves three planes at both ends of the table empty
    truth = rendered.anywhere(200, seed=1, low_nm=200.0, high_nm=1300.0)
    found = locate(
        rendered.images(truth, seed=2), method=method, table=rendered.table(method=method)
    )
    assert not found.lost.any()
    rms = np.sqrt(np.mean(errors_nm(found, truth) ** 2, axis=0))
    assert (rms < [lateral_nm, lateral_nm, axial_nm]).all(), rms


def test_default_measures_the_height_better_than_magtrack_alone():
    """The reason for own rings and own comparison: with magtrack z follows the pixels' phase."""
    truth = rendered.anywhere(200, seed=3, low_nm=200.0, high_nm=1300.0)
    stack = rendered.images(truth, seed=4)
    own, its = (
        np.std(errors_nm(locate(stack, method=m, table=rendered.table(method=m)), truth)[:, 2])
        for m in ("auto_conv_multiline", "magtrack")
    )
    assert own < its / 3, (own, its)


def test_centre_of_mass_is_pulled_towards_the_middle_of_the_region():
    """Known of it, and why it is not the default: the rings are cut off on one side."""
    truth = rendered.anywhere(100, seed=5)
    found = locate(rendered.images(truth, seed=6), method="center_of_mass")
    error = errors_nm(found, truth)[:, 0]
    assert np.corrcoef(error, truth[:, 0])[0, 1] < -0.9


@pytest.mark.parametrize("method", METHODS)
def test_x_is_along_columns_and_y_along_rows(method):
    stack = rendered.images([[35.0, 29.0, 700.0]], seed=8)
    found, turned = locate(stack, method=method), locate(stack.transpose(0, 2, 1), method=method)
    assert found.x_px - found.y_px > 2
    np.testing.assert_allclose(turned.x_px, found.y_px, atol=1e-6)
    np.testing.assert_allclose(turned.y_px, found.x_px, atol=1e-6)


def test_brightness_and_offset_do_not_matter():
    stack = rendered.images(rendered.anywhere(20, seed=9), seed=10).astype(float)
    before = locate(stack, table=rendered.table())
    after = locate(3.7 * stack + 50, table=rendered.table())
    np.testing.assert_allclose(after.x_px, before.x_px, atol=1e-9)
    np.testing.assert_allclose(after.z_nm, before.z_nm, atol=1e-6)


def test_each_image_is_measured_by_itself():
    stack = rendered.images(rendered.anywhere(150, seed=11), seed=12)
    together = locate(stack, table=rendered.table())
    alone = locate(stack[77:78], table=rendered.table())
    np.testing.assert_allclose(
        [alone.x_px[0], alone.y_px[0], alone.z_nm[0]],
        [together.x_px[77], together.y_px[77], together.z_nm[77]],
        rtol=1e-9,
    )


@pytest.mark.parametrize("method", METHODS)
def test_images_without_a_bead_are_lost(method):
    random = np.random.default_rng(0)
    empty = random.poisson(100, (300, rendered.SIZE_PX, rendered.SIZE_PX)).astype(np.uint8)
    dark = np.zeros((3, rendered.SIZE_PX, rendered.SIZE_PX), dtype=np.uint8)
    broken = np.full((1, rendered.SIZE_PX, rendered.SIZE_PX), np.nan)
    for stack in (empty, dark, broken):
        found = locate(stack, method=method, table=rendered.table(method=method))
        assert (found.lost > 0).all()
        assert np.isnan([found.x_px, found.y_px, found.z_nm]).all()
        assert (found.quality < 0.2).all()


def test_a_bead_out_of_its_region_is_lost_and_one_inside_is_not():
    path = np.arange(0.0, 60.0, 2.0)
    truth = np.column_stack(
        [rendered.MIDDLE_PX + path, np.full((len(path), 1), rendered.MIDDLE_PX), 0 * path + 700]
    )
    found = locate(rendered.images(truth, seed=13), table=rendered.table())
    near = path <= rendered.SIZE_PX / 4 - 2
    assert not found.lost[near].any()
    wrong = np.abs(found.x_px - truth[:, 0]) > 0.2
    assert not wrong.any()
    assert (found.lost[path > rendered.SIZE_PX / 4 + 1] > 0).all()


def test_saturated_rings_are_lost():
    bright = replace(Sensor(), background_e=9000.0)
    stack = rendered.images(rendered.anywhere(20, seed=14), sensor=bright, seed=15)
    assert stack.max() == bright.highest
    found = locate(stack, saturated_above=bright.highest)
    assert reasons(found) == {"saturated"}
    assert np.isnan(found.x_px[found.lost > 0]).all()
    assert not locate(stack, saturated_above=None).lost.any()


def test_another_bead_does_not_correlate_with_the_table():
    small = BeadImage.of(BeadOptics(300.0, rendered.PIXEL_NM, focus_nm=600.0), 600.0, 800.0)
    stack = rendered.images([[31.4, 31.8, 700.0]] * 5, seed=16, image=small)
    found = locate(stack, table=rendered.table())
    assert reasons(found) == {"correlation too low"}
    assert np.isnan(found.z_nm).all()
    assert not locate(stack).lost.any()


def test_outside_the_table_x_and_y_remain():
    short = rendered.build(*rendered.scan(low_nm=400.0, high_nm=1000.0))
    truth = np.array([[31.0, 32.0, z] for z in (300.0, 350.0, 700.0, 1050.0, 1100.0)])
    found = locate(rendered.images(truth, seed=17), table=short)
    assert [LOST_REASONS.get(code) for code in found.lost] == [
        "outside the look-up table",
        "outside the look-up table",
        None,
        "outside the look-up table",
        "outside the look-up table",
    ]
    np.testing.assert_allclose(found.x_px, truth[:, 0], atol=0.05)
    assert np.isnan(found.z_nm).tolist() == [True, True, False, True, True]


@pytest.mark.parametrize("shape", [(4, 64, 60), (64, 64), (4, 12, 12), (4, 64, 64, 3)])
def test_images_that_cannot_be_tracked_are_refused(shape):
    with pytest.raises(RecordingError, match="squares of at least"):
        locate(np.zeros(shape))


def test_table_and_images_must_fit():
    stack = rendered.images([[31.0, 31.0, 700.0]])
    with pytest.raises(RecordingError, match="60 pixels cannot be compared"):
        locate(stack[:, 2:-2, 2:-2], table=rendered.table())
    with pytest.raises(RecordingError, match="made with the method magtrack"):
        locate(stack, table=rendered.table(method="magtrack"))
    with pytest.raises(RecordingError, match="no method 'guess'"):
        locate(stack, method="guess")


def test_no_images_no_positions():
    found = locate(np.zeros((0, 64, 64), dtype=np.uint8), table=rendered.table())
    assert len(found.x_px) == len(found.lost) == 0


@pytest.mark.parametrize("method", METHODS)
def test_a_gpu_gets_the_images_and_gives_positions_back(monkeypatch, method):
    """cupy's two ways across, played by numpy: images go over, nothing stays there."""

    class OnDevice(np.ndarray):
        """An array that is not in the computer's own memory."""

    crossed = []

    def asarray(array):
        crossed.append(np.shape(array))
        return np.array(array).view(OnDevice)

    def asnumpy(array):
        return np.array(array).view(np.ndarray)

    stack = rendered.images(rendered.anywhere(5, seed=18), seed=19)
    expected = locate(stack, method=method, table=rendered.table(method=method))
    monkeypatch.setattr(magtrack(), "check_cupy", lambda: True)
    cupy = types.SimpleNamespace(asarray=asarray, asnumpy=asnumpy)
    monkeypatch.setitem(sys.modules, "cupy", cupy)
    found = locate(stack, method=method, table=rendered.table(method=method))
    assert crossed[0] == (64, 64, 5)
    for name in ("x_px", "y_px", "z_nm", "quality"):
        assert type(getattr(found, name)) is np.ndarray
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-6)


def test_magtrack_does_not_change_the_program_around_it():
    """It switches numpy's warnings off when it is imported, and warns of a missing GPU."""
    code = (
        "import sys, warnings, numpy as np\n"
        "import mtpipe.tracking.positions as positions\n"
        "assert not {'magtrack', 'numba'} & set(sys.modules)\n"
        "before, filters = np.geterr(), list(warnings.filters)\n"
        "positions.locate(np.random.default_rng(0).poisson(100, (2, 32, 32)))\n"
        "assert 'magtrack' in sys.modules\n"
        "assert np.geterr() == before and warnings.filters == filters\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
