"""What a film's header says of it: plans, series, channels, white as zero, wrong stamps."""

import os
from pathlib import Path

import numpy as np
import pytest
import tifffile

from mtpipe.ground.errors import RecordingError, SetupError
from mtpipe.setup.setup import read_setup
from mtpipe.tracking.stack import find_files, open_stack
from mtpipe.tracking.stack_look import Reading
from mtpipe.tracking.stack_times import frame_times
from mtpipe.tracking.track import track
from tests.stack_images import setup_text
from tests.test_stack import FRAMES, GREY, PLANES, everything, spread_film

TAKE = Reading(take_incomplete=True)
IMAGEJ = {"imagej": True, "metadata": {"axes": "TYX"}}


def codes(stack):
    return [notice.code for notice in stack.notices]


def ome(frames, planned, times, folder, name="film.ome.tif"):
    """An OME film whose metadata plan more frames than there are."""
    path = folder / name
    data = "".join(f'<TiffData FirstT="{k}" IFD="{k}" PlaneCount="1"/>' for k in range(planned))
    plane = "".join(f'<Plane TheC="0" TheZ="0" TheT="{k}" DeltaT="{t}"/>' for k, t in times)
    told = (
        '<?xml version="1.0" encoding="UTF-8"?><OME xmlns="http://www.openmicroscopy.org/Schemas/'
        'OME/2016-06"><Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYCZT" '
        'Type="uint16" SizeX="40" SizeY="32" SizeC="1" SizeZ="1" '
        f'SizeT="{planned}">{data}{plane}</Pixels></Image></OME>'
    )
    with tifffile.TiffWriter(path) as writer:
        for k, image in enumerate(frames):
            writer.write(image, contiguous=False, description=told if k == 0 else None, **GREY)
    return path


@pytest.mark.parametrize("shape", [(20, 32, 40, 1), (20, 1, 32, 40), (1, 20, 1, 32, 40, 1)])
def test_axes_of_one_count_no_frames(tmp_path, shape):
    tifffile.imwrite(tmp_path / "a.tif", FRAMES.reshape(shape), photometric="minisblack")
    assert np.array_equal(everything(open_stack(tmp_path / "a.tif")), FRAMES)


def test_the_header_of_each_file_may_count_the_whole_series(tmp_path):
    for k, piece in enumerate(np.split(FRAMES, 4)):
        path = tmp_path / f"film_{k}.tif"
        tifffile.imwrite(path, piece, imagej=True, metadata={"axes": "TYX"})
        with tifffile.TiffFile(path, mode="r+b") as tif:
            page = tif.pages.first
            told = page.description.replace("images=5", "images=20")
            page.tags["ImageDescription"].overwrite(told)
    assert np.array_equal(everything(open_stack(tmp_path)), FRAMES)
    for path in (tmp_path / "film_1.tif", tmp_path / "film_[012].tif"):
        with pytest.raises(RecordingError, match=r"announces 20 frames, (5|15) are there.*series"):
            open_stack(path)
    some = open_stack(tmp_path / "film_[012].tif", reading=TAKE)
    assert np.array_equal(everything(some), FRAMES[:15])
    assert codes(some) == ["film_incomplete"]


def test_a_film_that_was_stopped_by_hand_is_taken_with_a_caution(tmp_path):
    path = ome(FRAMES[:12], 20, [(k, 0.01 * k) for k in range(12)], tmp_path)
    stack = open_stack(path)
    assert np.array_equal(everything(stack), FRAMES[:12])
    (said,) = stack.notices
    assert said.severity == "caution"
    assert "planned for 20 frames, 12 are there" in said.message
    assert np.allclose(stack.stamps.time_s, 0.01 * np.arange(12))


def test_frames_that_were_taken_and_are_not_there_are_an_error_unless_the_rest_is_wanted(tmp_path):
    path = ome(FRAMES[:12], 20, [(k, 0.01 * k) for k in range(20)], tmp_path)
    with pytest.raises(RecordingError, match=r'frame 13 that is in none.*incomplete = "take"'):
        open_stack(path)
    assert np.array_equal(everything(open_stack(path, reading=TAKE)), FRAMES[:12])
    spread_film(tmp_path, ("", PLANES))
    (tmp_path / "1.ome.tif").unlink()
    with pytest.raises(RecordingError, match=r"frame 11 that is in none of its files"):
        open_stack(tmp_path / "0.ome.tif")
    stack = open_stack(tmp_path / "0.ome.tif", reading=TAKE)
    assert np.array_equal(everything(stack), FRAMES[:10])
    assert np.allclose(stack.stamps.time_s, 0.01 * np.arange(10))


@pytest.mark.parametrize("options", [GREY, {**GREY, "compression": "zlib"}])
def test_what_is_whole_of_a_film_cut_off_is_taken_by_choice(tmp_path, options):
    path = tmp_path / "film.tif"
    with tifffile.TiffWriter(path) as writer:
        for image in FRAMES:
            writer.write(image, contiguous=False, **options)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 6 // 10])
    with pytest.raises(RecordingError, match=r'incomplete = "take"'):
        open_stack(path)
    stack = open_stack(path, reading=TAKE)
    assert 5 <= stack.frames <= 12
    assert np.array_equal(everything(stack), FRAMES[: stack.frames])
    assert "film_incomplete" in codes(stack)


@pytest.mark.parametrize("one_header", [False, True])
def test_a_tail_of_zeros_is_no_end_of_a_film(tmp_path, one_header):
    path = tmp_path / "film.tif"
    tifffile.imwrite(path, FRAMES, photometric="minisblack", metadata=None)
    with tifffile.TiffFile(path) as tif:
        start = tif.pages[15].dataoffsets[0]
        end = tif.pages[19].dataoffsets[0] + FRAMES[0].nbytes
    data = bytearray(path.read_bytes())
    data[start:end] = bytes(end - start)
    path.write_bytes(bytes(data))
    if one_header:
        zeroed = FRAMES.copy()
        zeroed[15:] = 0
        tifffile.imwrite(path, zeroed, imagej=True, metadata={"axes": "TYX"})
    with pytest.raises(RecordingError, match=r"after page 15 \(the 5 frames after it are all zero"):
        open_stack(path)
    assert np.array_equal(everything(open_stack(path, reading=TAKE)), FRAMES[:15])


@pytest.mark.parametrize("options", [{}, IMAGEJ, {"compression": "packbits"}])
@pytest.mark.parametrize("zeros", [40, 700])
def test_a_last_frame_that_is_zero_in_part_is_not_whole(tmp_path, options, zeros):
    path = tmp_path / "film.tif"
    cut = FRAMES.copy()
    cut[-1].flat[-zeros:] = 0
    tifffile.imwrite(path, cut, photometric="minisblack", **options)
    with pytest.raises(RecordingError, match=r"after page 19 \(the frame after it .* in zeros"):
        open_stack(path)
    assert np.array_equal(everything(open_stack(path, reading=TAKE)), FRAMES[:19])
    dark = FRAMES.copy()
    dark.reshape(len(dark), -1)[:, -zeros:] = 0  # a corner that the camera never lights
    tifffile.imwrite(path, dark, photometric="minisblack", **options)
    assert np.array_equal(everything(open_stack(path)), dark)
    sparse = np.where(np.random.default_rng(5).random(FRAMES.shape) < 0.95, 0, FRAMES)
    tifffile.imwrite(path, sparse, photometric="minisblack", **options)
    assert np.array_equal(everything(open_stack(path)), sparse)


def test_pages_that_differ_are_no_damage(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        writer.write(FRAMES[:3], **GREY)
        writer.write(FRAMES[3, :30], **GREY)
    with pytest.raises(RecordingError, match="page 4: has 40 x 30 pixels"):
        open_stack(tmp_path / "a.tif", reading=TAKE)


def test_white_as_zero_is_turned_round(tmp_path):
    for name, frames in (("16.tif", FRAMES), ("8.tif", (FRAMES >> 4).astype(np.uint8))):
        highest = np.iinfo(frames.dtype).max
        turned = {"photometric": "miniswhite", "metadata": None}
        tifffile.imwrite(tmp_path / name, highest - frames, **turned)
        stack = open_stack(tmp_path / name)
        assert np.array_equal(everything(stack), frames)
        assert codes(stack) == ["white_is_zero"]
    tifffile.imwrite(tmp_path / "f.tif", FRAMES.astype(np.float32), **turned)
    with pytest.raises(RecordingError, match="white is zero of float32"):
        open_stack(tmp_path / "f.tif")


def test_channels_may_be_frames(tmp_path):
    told = {"axes": "CYX", "mode": "grayscale"}
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, imagej=True, metadata=told)
    with pytest.raises(RecordingError, match=r'20 channels.*frames = "channels"'):
        open_stack(tmp_path / "a.tif")
    stack = open_stack(tmp_path / "a.tif", reading=Reading(channels_are_frames=True))
    assert np.array_equal(everything(stack), FRAMES)
    two = FRAMES.reshape(10, 2, 32, 40)
    tifffile.imwrite(tmp_path / "b.tif", two, imagej=True, metadata={"axes": "TCYX"})
    with pytest.raises(RecordingError, match="2 channels"):
        open_stack(tmp_path / "b.tif", reading=Reading(channels_are_frames=True))


def test_wrong_stamps_are_put_aside_by_a_key_that_the_message_names(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, FRAMES, imagej=True, metadata={"axes": "TYX", "finterval": 0.011})
    stack = open_stack(path)
    with pytest.raises(RecordingError) as told:
        frame_times(stack.stamps, stack.frames, 100.0)
    assert '[tracking] times = "setup"' in str(told.value)
    time_s, (said,) = frame_times(stack.stamps, stack.frames, 100.0, put_aside=True)
    assert np.allclose(time_s, 0.01 * np.arange(20))
    assert said.code == "times_from_setup"
    assert "put aside" in said.message
    with pytest.raises(RecordingError, match="rate is unknown, and its stamps"):
        frame_times(stack.stamps, stack.frames, None, put_aside=True)


def test_the_keys_are_read_from_the_setup(tmp_path):
    keys = '[tracking]\nframes = "channels"\ntimes = "setup"\nincomplete = "take"'
    (tmp_path / "setup.toml").write_text(setup_text(keys))
    tracking = read_setup(tmp_path / "setup.toml").tracking
    assert Reading.chosen(tracking) == Reading(True, True)
    (tmp_path / "setup.toml").write_text(setup_text('[tracking]\ntimes = "guess"'))
    with pytest.raises(SetupError, match="times"):
        read_setup(tmp_path / "setup.toml")


@pytest.mark.parametrize("name", ["=cmd", "+1", "-x", "@a", "a\x1bb"])
def test_names_of_beads_are_no_formulas(tmp_path, name):
    region = f"[[tracking.regions]]\nname = {name!r}\nx_px = 9\ny_px = 9\nsize_px = 16"
    (tmp_path / "setup.toml").write_text(setup_text(region.replace("'a\\x1bb'", '"a\\u001bb"')))
    with pytest.raises(SetupError, match="name"):
        read_setup(tmp_path / "setup.toml")


@pytest.mark.parametrize("name", ["exp[2026]", "[A1]", "a*b?"])
def test_folders_may_have_names_like_patterns(tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    for k in range(3):
        tifffile.imwrite(folder / f"film_{k}.tif", FRAMES[k], **GREY)
    for path in (folder, folder / "film_*.tif", folder / "film_[0-2].tif"):
        assert len(find_files(path)) == 3
    assert find_files(folder / "film_2.tif") == [folder / "film_2.tif"]


@pytest.mark.slow
def test_names_that_are_no_utf_8(tmp_path, tracked):
    folder, *_ = tracked
    film = Path(os.fsdecode(os.fsencode(tmp_path / "film_") + b"\xe9.tif"))
    try:
        film.write_bytes((folder / "film.tif").read_bytes())
    except OSError:
        pytest.skip("this file system has names in UTF-8 only")
    for out in ("a.csv", "a.parquet"):
        done = track(film, tmp_path / out, setup=folder / "setup.toml")
        assert done.frames == 400
