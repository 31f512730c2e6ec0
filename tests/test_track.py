"""From stack to recording: positions, lost frames, tables, times and what is said of them."""

import errno
import os
import tracemalloc

import numpy as np
import pandas as pd
import pytest
import tifffile

import mtpipe
from mtpipe.ground.errors import MtpipeError, RecordingError, SetupError
from mtpipe.ingest.tracked import read_notes
from mtpipe.setup.setup import read_setup
from mtpipe.tracking.find_beads import Region
from mtpipe.tracking.follow import corner, cut, followed
from mtpipe.tracking.scan import focus_positions_nm, table_from_scan
from mtpipe.tracking.track import track
from mtpipe.tracking.track_files import RecordingWriter
from tests.stack_images import draw, setup_text
from tests.tracked_film import FIXED, FOCUS_NM, SHAPE, write

pytestmark = pytest.mark.slow


def test_positions_are_those_that_were_drawn(tracked):
    folder, truth, done = tracked
    table = pd.read_csv(folder / "recording.csv", comment="#")
    assert list(table.columns) == [
        "time_s", "magnet_mm",
        "bead1_x_nm", "bead1_y_nm", "bead1_z_nm", "bead1_quality",
        "bead2_x_nm", "bead2_y_nm", "bead2_z_nm", "bead2_quality",
    ]  # fmt: skip
    assert len(table) == done.frames == 400
    assert np.allclose(table.time_s, np.arange(400) / 100)
    for axis, true, limit in (("x", 100 * truth[0], 3), ("y", 100 * truth[1], 3)):
        error = table[f"bead1_{axis}_nm"] - true
        assert abs(error.mean()) < 0.5
        assert error.std() < limit
    assert (table.bead1_z_nm - truth[2]).std() < 20
    assert abs(table.bead2_x_nm.mean() - 100 * FIXED[0]) < 2
    assert abs(table.bead2_y_nm.mean() - 100 * FIXED[1]) < 2
    assert abs(table.bead2_z_nm.mean() - 200) < 5
    assert table.bead1_quality.between(0.9, 1).all()


def test_a_tracked_recording_is_read_with_its_notes(tracked):
    folder, _, done = tracked
    recording = mtpipe.load(folder / "recording.csv")
    assert recording.tethered == ("bead1",)
    assert [p.magnet_mm for p in recording.plateaus] == [3.0, 4.0]
    assert recording.tracked.table_height == {"bead1", "bead2"}
    # what the image says of its noise is what the fixed bead shows
    table = pd.read_csv(folder / "recording.csv", comment="#")
    shown = table[["bead2_x_nm", "bead2_y_nm", "bead2_z_nm"]].std()
    assert np.allclose(recording.tracked.precision_nm["bead2"], shown, rtol=0.35)
    # z = 0 as the setup has it, for the tethered bead
    assert np.allclose(recording.positions_nm["bead1"][:, 2], table.bead1_z_nm - 100)
    codes = [n.code for n in recording.notices]
    assert "times_from_setup" in codes
    assert "beads_found" in codes
    assert "unused_columns" not in codes
    assert read_notes(folder / "recording.csv") == done.notes


def test_without_z_zero_the_extension_is_unknown(tracked, tmp_path):
    folder, *_ = tracked
    text = (folder / "setup.toml").read_text()
    (tmp_path / "setup.toml").write_text(text.replace("z_zero.value_nm = 100.0", ""))
    recording = mtpipe.load(folder / "recording.csv", tmp_path / "setup.toml")
    assert "z_zero_unknown" in [n.code for n in recording.notices]
    assert np.isinf(recording.z_zero_stderr_nm["bead1"])


def test_without_a_table_z_is_empty_and_the_cost_is_told(tracked, tmp_path):
    folder, *_ = tracked
    (tmp_path / "setup.toml").write_text(setup_text(reference='"bead2"'))
    done = track(folder / "film.tif", tmp_path / "r.csv", setup=tmp_path / "setup.toml")
    table = pd.read_csv(tmp_path / "r.csv", comment="#")
    assert table.bead1_z_nm.isna().all()
    assert table.bead1_x_nm.notna().all()
    (said,) = [n for n in done.notes.notices if n.code == "no_look_up_table"]
    assert "no extension, and without extension no force" in said.message
    (tmp_path / "setup.toml").write_text(
        setup_text("[plateaus]\nminimum_s = 1.0", reference='"bead2"')
    )
    recording = mtpipe.load(tmp_path / "r.csv")
    assert recording.tracked.table_height == frozenset()
    assert np.isnan(recording.tracked.precision_nm["bead1"][2])


def test_lost_frames_are_empty_and_counted(scan, tmp_path):
    frames = draw(SHAPE, [(40.0, 45.0, 300.0), (*FIXED, 200.0)], seed=2)
    frames = np.repeat(frames, 120, axis=0)
    random = np.random.default_rng(0)
    noise = np.clip(100 + 2 * random.normal(size=(10, 60, 60)), 0, 255)
    frames[60:70, 10:70, 10:70] = noise.astype(np.uint8)  # the bead has gone
    frames[80:85, 20:70, 15:65] = 255  # light has flooded it
    write(tmp_path / "film.tif", frames)
    (tmp_path / "setup.toml").write_text(
        setup_text(
            '[tracking]\nregions = [{ name = "b", x_px = 40, y_px = 45, size_px = 31 }, '
            '{ name = "ref", x_px = 110, y_px = 51, size_px = 31 }]',
            reference='"ref"',
        )
    )
    done = track(tmp_path / "film.tif", tmp_path / "r.csv")
    table = pd.read_csv(tmp_path / "r.csv", comment="#")
    lost = [*range(60, 70), *range(80, 85)]
    assert list(np.flatnonzero(table.b_x_nm.isna())) == lost
    assert list(np.flatnonzero(table.b_y_nm.isna())) == lost
    assert table.ref_x_nm.notna().all()
    assert sum(done.notes.lost["b"].values()) == 15
    (said,) = [n for n in done.notes.notices if n.code == "lost_by_tracker"]
    assert said.bead == "b"
    assert said.message.startswith("The tracker lost it in 15 of 120 frames: ")


def test_a_bead_that_jumps_is_found_again(tmp_path):
    k = np.arange(500)
    x = np.where(k < 140, 40.0, 58.0)
    write(tmp_path / "film.tif", draw(SHAPE, [(x, 45.0, 300.0), (*FIXED, 200.0)]))
    (tmp_path / "setup.toml").write_text(setup_text(reference='"bead2"'))
    track(tmp_path / "film.tif", tmp_path / "r.csv")
    table = pd.read_csv(tmp_path / "r.csv", comment="#")
    # lost from the jump to the end of that chunk of 128 frames, then followed
    assert table.bead1_x_nm[:140].notna().all()
    assert table.bead1_x_nm[256:].notna().all()
    assert np.allclose(table.bead1_x_nm[256:], 5800, atol=15)


def test_a_bead_that_is_gone_does_not_become_its_neighbour(tmp_path):
    both = draw(SHAPE, [(40.0, 45.0, 300.0), (71.0, 45.0, 200.0), (*FIXED, 200.0)])
    one = draw(SHAPE, [(71.0, 45.0, 200.0), (*FIXED, 200.0)])
    write(tmp_path / "film.tif", np.concatenate([both] * 100 + [one] * 300))
    (tmp_path / "setup.toml").write_text(setup_text(reference='"bead2"'))
    track(tmp_path / "film.tif", tmp_path / "r.csv")
    table = pd.read_csv(tmp_path / "r.csv", comment="#")
    assert table.bead1_x_nm[:100].notna().all()
    assert table.bead1_x_nm[100:].isna().all()
    assert table.bead2_x_nm.notna().all()


@pytest.mark.parametrize(("more", "lost"), [("", 0), ("saturated_above = 4095", 30)])
def test_saturation_of_a_camera_with_fewer_bits_than_its_file(tmp_path, more, lost):
    frame = draw(SHAPE, [(40.0, 45.0, 300.0), (*FIXED, 300.0)], level=2500.0, dtype=np.uint16)
    dim = draw(SHAPE, [(40.0, 45.0, 300.0), (*FIXED, 300.0)], level=1500.0, dtype=np.uint16)
    bright = np.minimum(frame.astype(int) * 2, 4095).astype(np.uint16)
    write(tmp_path / "film.tif", np.concatenate([dim] * 30 + [bright] * 30))
    (tmp_path / "setup.toml").write_text(setup_text(f"[tracking]\n{more}", reference='"bead2"'))
    done = track(tmp_path / "film.tif", tmp_path / "r.csv")
    assert done.notes.lost["bead1"].get("saturated", 0) == lost


def test_following_stays_within_the_image():
    region = Region("b", 20.0, 30.0, 21)
    assert corner(region, (60, 80)) == (20, 10)
    assert corner(Region("b", 2.0, 59.0, 21), (60, 80)) == (39, 0)
    assert cut(np.zeros((3, 60, 80)), region).shape == (3, 21, 21)
    x, y = np.full(40, 24.0), np.full(40, 31.0)
    x[-5:] = np.nan
    assert followed(region, x, y) == Region("b", 24.0, 31.0, 21)
    assert followed(region, np.full(40, np.nan), y) == region


def test_memory_does_not_grow_with_the_length(tmp_path):
    image = draw((96, 96), [(40.0, 50.0, 0.0)])[0]
    (tmp_path / "setup.toml").write_text(setup_text("[tracking]\nmethod = 'center_of_mass'"))

    def peak(frames):
        with tifffile.TiffWriter(tmp_path / "film.tif") as writer:
            for _ in range(frames):
                writer.write(image, photometric="minisblack", metadata=None, contiguous=False)
        tracemalloc.start()
        try:
            track(tmp_path / "film.tif", tmp_path / "r.csv")
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(130)  # what is imported and compiled once
    short, long = peak(400), peak(700)  # both with three whole chunks
    assert long - short < 5e5  # 300 frames more are 2.8 MB


# ------------------------------------------------------------------ tables


def test_a_table_from_named_frames_and_micrometres(scan, tmp_path):
    rows = pd.DataFrame({"frame": np.arange(4, 60), "z_um": FOCUS_NM[4:60] / 1000})
    rows.to_csv(tmp_path / "z.csv", index=False)
    z_nm = focus_positions_nm(tmp_path / "z.csv", 64)
    assert np.isnan(z_nm[:4]).all()
    assert np.isnan(z_nm[60:]).all()
    assert np.allclose(z_nm[4:60], FOCUS_NM[4:60])
    (tmp_path / "setup.toml").write_text(setup_text())
    table = table_from_scan(
        scan / "scan.tif",
        tmp_path / "z.csv",
        refractive_index_factor=0.8,
        region=(40.0, 45.0, 41),
        bead="mine",
        setup=read_setup(tmp_path / "setup.toml"),
    )
    assert (table.bead, table.region_size_px, table.pixel_size_nm) == ("mine", 41, 100.0)
    assert table.scanned_nm == pytest.approx((0.8 * 40, 0.8 * 580))


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ("z_nm\n1\n2\n", "has 2 rows where the stack has 64 frames"),
        ("height\n1\n", r"has no column z_nm \(or z_um\).*It has: height"),
        ("frame,z_nm\n64,1\n", "names frame 64, but the stack has 64 frames, 0 to 63"),
        ("frame,z_nm\n3,1\n4,2\n3,5\n", "names frame 3 twice"),
        ("z_nm\n", "has no rows"),
    ],
)
def test_positions_that_do_not_fit_the_scan(tmp_path, content, match):
    (tmp_path / "z.csv").write_text(content)
    with pytest.raises(RecordingError, match=match):
        focus_positions_nm(tmp_path / "z.csv", 64)


def test_several_beads_in_a_scan_need_a_name(scan):
    with pytest.raises(MtpipeError, match=r"that of one bead: 2 beads were found.*--bead"):
        table_from_scan(scan / "scan.tif", scan / "z.csv", refractive_index_factor=1.0)
    with pytest.raises(MtpipeError, match=r"no bead 'b9' in the scan"):
        table_from_scan(scan / "scan.tif", scan / "z.csv", refractive_index_factor=1.0, bead="b9")


# ------------------------------------------------------------------ what a setup can get wrong


@pytest.mark.parametrize(
    ("more", "reference", "match"),
    [
        ("[tracking]\nmethod = 'magic'", "", r"\[tracking\] method: there is no method 'magic'"),
        (
            "[tracking]\nregions = [{name = 'a', x_px = 40, y_px = 45, size_px = 31}]",
            '"ref1"',
            r"\[beads\] reference names 'ref1', which is none of the beads: there are a",
        ),
        ("[tracking]\nlook_up_table = 'no.npz'", "", "no.npz: there is no such look-up table"),
        (
            "[tracking]\nregions = [{name = 'a', x_px = 5, y_px = 50, size_px = 31}]",
            "",
            "region of a, 31 pixels about x = 5, y = 50, is cut by the border",
        ),
        (
            "[tracking]\nlook_up_table_of = {b7 = '%s/bead1.npz'}",
            "",
            r"look_up_table_of names 'b7', which is none of the beads",
        ),
        ("[tracking]\nsize_px = 8", "", r"tracking.size_px"),
        ("[tracking]\nmagnet = {column = 1}", "", r"an image stack has no columns"),
        (
            "[tracking]\nregions = [{name = 'a', x_px = 40, y_px = 45, size_px = 31}, "
            "{name = 'a', x_px = 41, y_px = 45, size_px = 31}]",
            "",
            "two are named 'a'",
        ),
        (
            "[tracking]\nregions = [{name = 'a', x_px = 40, y_px = 45, size_px = 31}, "
            "{name = 'b', x_px = 50, y_px = 46, size_px = 31}]",
            "",
            "regions of a and b overlap so far .* centres are 10 pixels apart",
        ),
        (
            "[tracking]\nregions = [{name = 'a b', x_px = 40, y_px = 45, size_px = 31}]",
            "",
            "has no spaces, commas or quotes",
        ),
        ("[tracking]\nsize_px = 90", "", "cut by the border of the image.* smaller size_px"),
    ],
)
def test_a_setup_that_cannot_be(tracked, scan, tmp_path, more, reference, match):
    folder, *_ = tracked
    more = more % scan if "%s" in more else more
    (tmp_path / "setup.toml").write_text(setup_text(more, reference))
    with pytest.raises(MtpipeError, match=match):
        track(folder / "film.tif", tmp_path / "r.csv", setup=tmp_path / "setup.toml")
    assert not (tmp_path / "r.csv").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["setup.toml"]


def test_pixels_of_unknown_or_another_size(tracked, scan, tmp_path):
    folder, *_ = tracked
    text = setup_text()
    (tmp_path / "setup.toml").write_text(text.replace("pixel_size_nm = 100.0", ""))
    with pytest.raises(SetupError, match=r"pixel_size_nm is missing"):
        track(folder / "film.tif", tmp_path / "r.csv", setup=tmp_path / "setup.toml")
    made = table_from_scan(
        scan / "scan.tif",
        scan / "z.csv",
        refractive_index_factor=1.0,
        bead="bead1",
        setup=read_setup(folder / "setup.toml"),
    )
    made.save(tmp_path / "t.npz")
    (tmp_path / "setup.toml").write_text(
        setup_text('[tracking]\nlook_up_table = "t.npz"').replace("nm = 100.0", "nm = 90.0")
    )
    with pytest.raises(RecordingError, match="made with pixels of 100 nm, the setup says 90 nm"):
        track(folder / "film.tif", tmp_path / "r.csv", setup=tmp_path / "setup.toml")


def test_a_recording_of_a_kind_that_is_not_written(tracked, tmp_path):
    folder, *_ = tracked
    with pytest.raises(MtpipeError, match=r"written as \.csv, \.csv\.gz or \.parquet"):
        track(folder / "film.tif", tmp_path / "r.xlsx")


def test_a_full_disc_is_told_and_leaves_nothing(tracked, tmp_path, monkeypatch):
    folder, *_ = tracked

    def full(self, table):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(RecordingWriter, "write_table", full)
    with pytest.raises(MtpipeError, match=r"r\.csv: cannot be written \(No space left"):
        track(folder / "film.tif", tmp_path / "r.csv")
    assert not list(tmp_path.iterdir())


def test_a_table_of_another_bead_is_used_with_a_notice(tracked, scan, tmp_path):
    folder, *_ = tracked
    (tmp_path / "setup.toml").write_text(
        setup_text(f'[tracking]\nlook_up_table = "{scan}/bead1.npz"')
    )
    done = track(folder / "film.tif", tmp_path / "r.csv", setup=tmp_path / "setup.toml")
    said = [n for n in done.notes.notices if n.code == "other_beads_table"]
    assert [n.bead for n in said] == ["bead2"]
    assert "look-up table of bead1" in said[0].message


def test_damaged_notes_are_told(tracked, tmp_path):
    folder, *_ = tracked
    text = (folder / "recording.csv").read_text()
    (tmp_path / "r.csv").write_text(text.replace('"precision_nm"', '"precision', 1))
    with pytest.raises(RecordingError, match="notes on tracking"):
        mtpipe.load(tmp_path / "r.csv", folder / "setup.toml")


def test_a_reference_named_before_beads_are_found_is_told(tracked, tmp_path):
    """The setup of a new film cannot know the names that beads will get."""
    folder, *_ = tracked
    (tmp_path / "setup.toml").write_text(setup_text("", '"ref1"'))
    done = track(folder / "film.tif", tmp_path / "r.csv", setup=tmp_path / "setup.toml")
    (said,) = [n.message for n in done.notes.notices if n.code == "no_such_reference"]
    assert "names 'ref1', which is none of the beads: there are bead1, bead2" in said
    with pytest.raises(MtpipeError, match="ref1"):
        mtpipe.load(tmp_path / "r.csv")
