"""Look-up tables: heights between the planes, what a scan can tell, and the file."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pytest

from mtpipe.ground.errors import RecordingError
from mtpipe.simulation.bead_image import BeadImage, BeadOptics
from mtpipe.tracking.information import confused_with, longest_without
from mtpipe.tracking.lookup_table import MIN_PLANES, LookUpTable
from mtpipe.tracking.matching import normalized
from mtpipe.tracking.positions import locate
from tests import rendered

pytestmark = pytest.mark.slow


def between_planes(table, step_nm, sensor_seed=3):
    """Errors of z at ten places between planes, (planes, 10), the same places in x and y."""
    starts = np.arange(400.0, 1100.0, step_nm)
    heights = (starts[:, None] + step_nm * np.arange(10) / 10).ravel()
    random = np.random.default_rng(sensor_seed)
    xy = rendered.MIDDLE_PX + random.uniform(-1, 1, (len(heights), 2))
    found = locate(
        rendered.images(np.column_stack([xy, heights]), seed=sensor_seed),
        table=table,
        method=table.method,
    )
    assert not found.lost.any()
    return (found.z_nm - heights).reshape(len(starts), 10)


@pytest.mark.parametrize(("step_nm", "most_nm"), [(25.0, 1.5), (50.0, 1.5), (100.0, 3.0)])
def test_heights_between_planes_are_not_drawn_to_the_planes(step_nm, most_nm):
    error = between_planes(rendered.table(step_nm=step_nm), step_nm)
    assert np.sqrt(np.mean(error**2)) < most_nm
    assert np.abs(error.mean(axis=0)).max() < most_nm


def test_magtracks_parabola_is_biased_where_planes_are_far_apart():
    """The reason for the spline; if magtrack mends it, docs/tracking-accuracy.md needs mending."""
    own = between_planes(rendered.table(step_nm=100.0), 100.0)
    its = between_planes(rendered.table(method="magtrack", step_nm=100.0), 100.0)
    assert np.sqrt(np.mean(its**2)) > 3 * np.sqrt(np.mean(own**2))


@pytest.mark.parametrize("factor", [0.88, -0.8])
def test_heights_are_focus_positions_times_the_factor(factor):
    stack, heights = rendered.scan(repeats=2)
    table = rendered.build(stack, heights / factor, factor=factor)
    plain = rendered.build(stack, heights)
    np.testing.assert_allclose(table.z_nm, plain.z_nm, atol=1e-9)
    np.testing.assert_allclose(table.profiles, plain.profiles)
    assert table.refractive_index_factor == factor
    assert table.scanned_nm == (0.0, 1500.0)


def test_images_of_one_focus_are_averaged_in_any_order():
    stack, heights = rendered.scan(repeats=4)
    table = rendered.build(stack, heights)
    order = np.random.default_rng(0).permutation(len(heights))
    shuffled = rendered.build(stack[order], heights[order])
    np.testing.assert_allclose(shuffled.profiles, table.profiles)
    assert len(table.z_nm) == 31
    assert table.notices == ()


def test_the_scans_noise_says_how_precise_a_height_can_be():
    """What it says is at most; the rest of the image that is not circular counts as well."""
    table = rendered.table()
    truth = rendered.anywhere(200, seed=1)
    error = locate(rendered.images(truth, seed=2), table=table).z_nm - truth[:, 2]
    assert 0.4 < np.std(error) / np.median(table.precision_nm) < 1.2


@functools.cache
def absorbing() -> BeadImage:
    """A bead that only absorbs looks the same on both sides of focus."""
    optics = BeadOptics(
        1000.0, rendered.PIXEL_NM, focus_nm=0.0, bead_index=1.33, absorption_per_nm=1e-3
    )
    return BeadImage.of(optics, -1500.0, 2000.0)


def test_a_scan_through_focus_keeps_one_side():
    stack, heights = rendered.scan(
        step_nm=100.0, image=absorbing(), low_nm=-1200.0, high_nm=2000.0, repeats=3
    )
    table = rendered.build(stack, heights)
    assert [notice.code for notice in table.notices] == ["scan_ambiguous"]
    assert table.z_nm[0] >= -100.0
    assert table.z_nm[-1] == 2000.0
    assert table.scanned_nm == (-1200.0, 2000.0)
    assert f"keeps {table.z_nm[0]:.0f} to 2000 nm" in table.notices[0].message


def test_a_scan_on_one_side_of_focus_is_kept_whole():
    stack, heights = rendered.scan(
        step_nm=100.0, image=absorbing(), low_nm=300.0, high_nm=2000.0, repeats=3
    )
    table = rendered.build(stack, heights)
    assert table.notices == ()
    assert len(table.z_nm) == 18


def test_a_scan_that_did_not_move_is_refused():
    stack = rendered.images([[31.5, 31.5, 700.0]] * 100)
    with pytest.raises(RecordingError, match="do not differ by more than their noise"):
        rendered.build(stack, np.repeat(np.arange(20) * 50.0, 5))


def test_images_without_the_bead_are_left_out_and_told():
    stack, heights = rendered.scan(repeats=3)
    stack[4:6] = 100
    table = rendered.build(stack, heights)
    assert [notice.code for notice in table.notices] == ["scan_images_lost"]
    assert "no bead 2" in table.notices[0].message
    assert len(table.z_nm) == 31


def test_saturated_images_are_no_part_of_a_table():
    stack, heights_nm = rendered.scan(repeats=2)
    stack[10] = np.minimum(stack[10] * 1.9, 255).astype(stack.dtype)
    table = rendered.build(stack, heights_nm, saturated_above=255.0)
    assert "saturated 1" in table.notices[0].message
    with pytest.raises(RecordingError, match=r"found at 0 heights.*images lost: saturated 62"):
        rendered.build(stack, heights_nm, saturated_above=1.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda stack, z: (stack[:12], z[:12]), f"needs {MIN_PLANES}"),
        (lambda stack, z: (stack[:-1], z), "do not fit"),
        (lambda stack, z: (stack, np.where(z == 100.0, np.nan, z)), "not a number"),
        (lambda stack, z: (np.full_like(stack, 90), z), "found at 0 heights"),
    ],
)
def test_scans_that_are_no_table(change, said):
    with pytest.raises(RecordingError, match=said):
        rendered.build(*change(*rendered.scan(repeats=2)))


@pytest.mark.parametrize("factor", [0.0, 88.0, np.nan])
def test_factors_that_cannot_be(factor):
    with pytest.raises(RecordingError, match="refractive-index factor"):
        rendered.build(*rendered.scan(repeats=2), factor=factor)


def test_a_table_comes_back_from_its_file(tmp_path):
    table = rendered.build(*rendered.scan(), factor=0.88)
    table.save(tmp_path / "lut.npz")
    back = LookUpTable.load(tmp_path / "lut.npz")
    for name in ("z_nm", "profiles", "noise"):
        np.testing.assert_array_equal(getattr(back, name), getattr(table, name))
    for name in ("bead", "region_size_px", "pixel_size_nm", "method", "source", "made"):
        assert getattr(back, name) == getattr(table, name)
    assert back.refractive_index_factor == 0.88
    assert back.scanned_nm == table.scanned_nm
    stack = rendered.images([[31.0, 32.0, 500.0]])
    assert locate(stack, table=back).z_nm == locate(stack, table=table).z_nm


def test_files_that_are_no_table(tmp_path):
    with pytest.raises(RecordingError, match="no such look-up table"):
        LookUpTable.load(tmp_path / "none.npz")
    whole = tmp_path / "whole.npz"
    rendered.table().save(whole)
    for name, content in {
        "text.npz": b"z,profile\n",
        "cut.npz": whole.read_bytes()[:-200],
        "empty.npz": b"",
    }.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(RecordingError, match="not a look-up table of mtpipe"):
            LookUpTable.load(tmp_path / name)
    np.savez(tmp_path / "other.npz", z_nm=np.arange(3))
    with pytest.raises(RecordingError, match="not a look-up table of mtpipe"):
        LookUpTable.load(tmp_path / "other.npz")
    with np.load(whole) as file:
        arrays = dict(file)
    arrays["metadata"] = np.array(json.dumps({"schema": "mtpipe.lookup_table/0"}))
    np.savez(tmp_path / "old.npz", **arrays)
    with pytest.raises(RecordingError, match="another version"):
        LookUpTable.load(tmp_path / "old.npz")


def test_confusion_of_points_on_a_curve():
    """An open curve confuses only neighbours; a curve that comes back confuses what it meets."""
    angle = np.linspace(0, 1.5 * np.pi, 40)
    open_curve = np.column_stack([np.cos(angle), np.sin(angle)])
    closed = np.vstack([open_curve, open_curve[:4]])
    noise = np.full(len(closed), 0.01)
    confused, unresolved = confused_with(open_curve, noise[:40])
    assert not confused.any()
    assert not unresolved.any()
    confused, _ = confused_with(closed, noise)
    assert confused[0, 40]
    assert confused[40, 0]
    first, last = longest_without(confused)
    assert last - first < 44
    assert not confused[first:last, first:last].any()
    assert longest_without(~np.eye(5, dtype=bool)) == (0, 1)
    assert longest_without(np.zeros((5, 5), dtype=bool)) == (0, 5)


def test_normalized_profiles_correlate_pixel_by_pixel():
    """Their product is the correlation of the two circular images the profiles stand for."""
    random = np.random.default_rng(0)
    profiles = random.normal(size=(2, 20)) + 100
    counts = 1000 * np.concatenate([[1 / (2 * np.pi)], np.arange(1.0, 20.0)])
    pixels = np.repeat(profiles, np.rint(counts).astype(int), axis=1)
    first, second = normalized(profiles)
    assert first @ second == pytest.approx(np.corrcoef(pixels)[0, 1], abs=1e-4)


def test_a_real_focus_scan_is_followed():
    """Every second image of a laboratory's scan makes the table, those between are tracked."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "recordings" / "vannoort-stacks"
    if not folder.is_dir():
        pytest.skip(f"no recordings in {folder}")
    from nptdms import TdmsFile

    images = np.fromfile(folder / "data_024ROI.bin", np.uint8).reshape(-1, 100, 100)
    groups = TdmsFile.read(folder / "data_024.tdms").groups()
    focus_nm = 1e6 * next(c[:] for g in groups for c in g.channels() if c.name == "Focus (mm)")
    table = rendered.build(images[::2], focus_nm[::2])
    assert table.notices == ()
    found = locate(images[1::2], table=table)
    assert not found.lost.any()
    error = found.z_nm - focus_nm[1::2]
    # out of focus in the second half; planes are 130 nm apart
    assert abs(np.mean(error)) < 2
    assert np.std(error[len(error) // 2 :]) < 8
