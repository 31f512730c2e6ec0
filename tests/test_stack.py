"""Reading image stacks: every kind that is promised, and a sentence for each that is none."""

import datetime
import logging
import tracemalloc

import numpy as np
import pytest
import tifffile

import mtpipe
from mtpipe.ground.errors import RecordingError
from mtpipe.tracking.stack import check_unchanged, is_stack, open_stack
from mtpipe.tracking.stack_times import frame_times
from tests.stack_images import setup_text

pytestmark = pytest.mark.slow

FRAMES = np.random.default_rng(0).integers(0, 4096, (20, 32, 40)).astype(np.uint16)
GREY = {"photometric": "minisblack", "metadata": None}


def everything(stack, frames=7):
    chunks = list(stack.chunks(frames))
    assert all(len(c) == frames for c in chunks[:-1])
    return np.concatenate(chunks)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("plain.tif", GREY),
        ("big.tif", {**GREY, "bigtiff": True}),
        ("motorola.tif", {**GREY, "byteorder": ">"}),
        ("deflate.tif", {**GREY, "compression": "zlib", "predictor": True}),
        ("lzw.tif", {**GREY, "compression": "lzw"}),
        ("zstd.tif", {**GREY, "compression": "zstd"}),
        ("packbits.tif", {**GREY, "compression": "packbits"}),
        ("tiled.tif", {**GREY, "tile": (16, 16)}),
        ("imagej.tif", {"imagej": True, "metadata": {"axes": "TYX"}}),
        ("shaped.tif", {"photometric": "minisblack"}),
        ("film.ome.tif", {"metadata": {"axes": "TYX"}}),
    ],
)
def test_every_carrier_gives_the_same_frames(tmp_path, name, options):
    tifffile.imwrite(tmp_path / name, FRAMES, **options)
    stack = open_stack(tmp_path / name)
    assert (stack.frames, stack.height, stack.width, stack.bits) == (20, 32, 40, 16)
    assert np.array_equal(everything(stack), FRAMES)
    assert stack.stamps is None


def test_eight_bit_floats_and_packed_twelve_bit(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", (FRAMES >> 4).astype(np.uint8), **GREY)
    assert open_stack(tmp_path / "a.tif").bits == 8
    tifffile.imwrite(tmp_path / "b.tif", FRAMES.astype(np.float32), **GREY)
    stack = open_stack(tmp_path / "b.tif")
    assert stack.bits == 0
    assert np.array_equal(everything(stack), FRAMES)
    import imagecodecs

    packed = [imagecodecs.packints_encode(image, 12) for image in FRAMES]
    with tifffile.TiffWriter(tmp_path / "c.tif") as writer:
        for image in packed:
            writer.write(
                iter([image]), shape=(32, 40), dtype=np.uint16, bitspersample=12, rowsperstrip=32,
                compression="none", **GREY,
            )  # fmt: skip
    stack = open_stack(tmp_path / "c.tif")
    assert stack.bits == 12
    assert np.array_equal(everything(stack), FRAMES)


def test_ome_tells_the_bits_of_the_camera_for_all_files_of_a_series(tmp_path):
    for k in range(3):
        tifffile.imwrite(
            tmp_path / f"{k}.ome.tif", FRAMES[:2], metadata={"axes": "TYX", "SignificantBits": 12}
        )
    assert open_stack(tmp_path / "0.ome.tif").bits == 12
    stack = open_stack(tmp_path)
    assert (stack.frames, stack.bits) == (6, 12)


def test_a_stack_is_no_recording(tmp_path):
    (tmp_path / "setup.toml").write_text(setup_text())
    for big in (False, True):
        tifffile.imwrite(tmp_path / "a.tif", FRAMES, bigtiff=big, **GREY)
        with pytest.raises(RecordingError, match=r"is an image stack.*mtpipe track"):
            mtpipe.load(tmp_path / "a.tif")


def test_one_header_for_many_frames_as_imagej_does_beyond_4_gb(tmp_path):
    path = tmp_path / "virtual.tif"
    tifffile.imwrite(path, FRAMES, imagej=True, metadata={"axes": "TYX", "finterval": 0.02})
    with tifffile.TiffFile(path) as tif:
        first = tif.pages.first
        link = first.offset + 2 + 12 * len(first.tags)  # to the header of page 2
    content = bytearray(path.read_bytes())
    content[link : link + 4] = b"\0\0\0\0"
    path.write_bytes(bytes(content))
    stack = open_stack(path)
    assert stack.frames == 20
    assert stack.files[0].offset is not None
    assert np.array_equal(everything(stack), FRAMES)
    path.write_bytes(bytes(content[: stack.files[0].offset + 19 * 32 * 40 * 2]))
    with pytest.raises(RecordingError, match=r"cut off"):
        open_stack(path)


def test_series_of_files_in_numerical_order(tmp_path):
    folder = tmp_path / "film"
    folder.mkdir()
    (folder / "setup.toml").write_text("")
    for k, image in enumerate(FRAMES):
        tifffile.imwrite(folder / f"img_{k}.tif", image, **GREY)
    for path in (folder, folder / "img_*.tif"):
        stack = open_stack(path)
        assert len(stack.files) == 20
        assert np.array_equal(everything(stack), FRAMES)
        assert not stack.notices
        assert is_stack(path)
    (folder / "img_4.tif").unlink()
    (folder / "img_5.tif").unlink()
    (said,) = open_stack(folder).notices
    assert said.code == "missing_files"
    assert said.message.startswith("2 numbers are missing")
    assert "img_3.tif" in said.message


def test_series_of_files_of_many_pages(tmp_path):
    for k in (2, 10, 1):
        tifffile.imwrite(tmp_path / f"film_{k}.tif", FRAMES[: k + 1] + np.uint16(k), **GREY)
    stack = open_stack(tmp_path)
    expected = np.concatenate([FRAMES[: k + 1] + np.uint16(k) for k in (1, 2, 10)])
    assert np.array_equal(everything(stack), expected)


def test_what_is_a_stack(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, **GREY)
    assert is_stack(tmp_path / "a.tif")
    assert is_stack(tmp_path)
    (tmp_path / "recording.csv").write_text("time_s\n")
    (tmp_path / "setup.toml").write_text(setup_text())
    assert not is_stack(tmp_path / "recording.csv")
    assert not is_stack(tmp_path)
    assert not is_stack(tmp_path / "absent.csv")


def test_the_magnets_log_beside_images_is_no_recording(tmp_path):
    for k in range(3):
        tifffile.imwrite(tmp_path / f"img_{k}.tif", FRAMES[k], **GREY)
    (tmp_path / "motors.csv").write_text("frame,mm\n")
    log = '[tracking.magnet]\nfile = "motors.csv"\ncolumn = "mm"\nrow_by_row = true'
    (tmp_path / "setup.toml").write_text(setup_text())
    assert not is_stack(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    for folder, name in ((tmp_path, "motors.csv"), (tmp_path / "elsewhere", "../motors.csv")):
        (folder / "setup.toml").write_text(setup_text(log.replace("motors.csv", name)))
        assert is_stack(tmp_path, folder / "setup.toml")
    (tmp_path / "recording.csv").write_text("time_s\n")
    assert not is_stack(tmp_path)


# ------------------------------------------------------------------ times


def times(path, stated=None):
    stack = open_stack(path)
    return frame_times(stack.stamps, stack.frames, stated)


def test_times_of_ome_planes(tmp_path):
    delta = [5.0 + 12.5 * k for k in range(20)]
    plane = {"DeltaT": delta, "DeltaTUnit": ["ms"] * 20}
    tifffile.imwrite(tmp_path / "a.ome.tif", FRAMES, metadata={"axes": "TYX", "Plane": plane})
    time_s, (said,) = times(tmp_path / "a.ome.tif", 80.0)
    assert np.allclose(time_s, 0.0125 * np.arange(20), atol=1e-12)
    assert said.code == "times_from_stack"
    assert "OME DeltaT" in said.message
    with pytest.raises(RecordingError, match=r"setup says 100 frames per second.*say 80"):
        times(tmp_path / "a.ome.tif", 100.0)


def spread_film(folder, times):
    """An OME film of two files, whose metadata stand in both; `times` are its Plane elements."""
    ids = [f"urn:uuid:{k}0000000-0000-0000-0000-000000000000" for k in range(2)]
    data = "".join(
        f'<TiffData FirstT="{k}" IFD="{k % 10}" PlaneCount="1">'
        f'<UUID FileName="{k // 10}.ome.tif">{ids[k // 10]}</UUID></TiffData>'
        for k in range(20)
    )
    for k in range(2):
        told = (
            '<?xml version="1.0" encoding="UTF-8"?><OME xmlns="http://www.openmicroscopy.org/'
            f'Schemas/OME/2016-06" UUID="{ids[k]}"><Image ID="Image:0"><Pixels ID="Pixels:0" '
            'DimensionOrder="XYCZT" Type="uint16" SizeX="40" SizeY="32" SizeC="1" SizeZ="1" '
            f'SizeT="20" {times[0]}>{data}{times[1]}</Pixels></Image></OME>'
        )
        pages_with(
            folder / f"{k}.ome.tif",
            lambda page, told=told: {} if page else {"description": told},
            FRAMES[10 * k : 10 * k + 10],
        )


PLANES = "".join(f'<Plane TheC="0" TheZ="0" TheT="{k}" DeltaT="{0.01 * k}"/>' for k in range(20))


@pytest.mark.parametrize("times_told", [("", PLANES), ('TimeIncrement="0.01"', "")])
def test_times_of_an_ome_film_that_is_spread_over_files(tmp_path, times_told):
    spread_film(tmp_path, times_told)
    stack = open_stack(tmp_path / "0.ome.tif")
    assert np.array_equal(everything(stack), FRAMES)
    time_s, notices = times(tmp_path / "0.ome.tif", 100.0)
    assert np.allclose(time_s, 0.01 * np.arange(20), atol=1e-12)
    assert notices[0].code == "times_from_stack"


def test_ome_times_that_are_no_numbers_are_none(tmp_path):
    path = tmp_path / "a.ome.tif"
    metadata = {"axes": "TYX", "TimeIncrement": 0.0125}
    tifffile.imwrite(path, FRAMES, metadata=metadata)
    content = path.read_bytes()
    assert content.count(b'"0.0125"') == 1
    path.write_bytes(content.replace(b'"0.0125"', b'"often!"'))
    _, (said,) = times(path, 80.0)
    assert said.code == "times_from_setup"


def test_times_of_imagej_are_its_interval_and_not_its_player(tmp_path):
    told = {"axes": "TYX", "finterval": 0.02, "fps": 7.0}
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, imagej=True, metadata=told)
    time_s, notices = times(tmp_path / "a.tif")
    assert np.allclose(time_s, 0.02 * np.arange(20))
    assert [n.code for n in notices] == ["times_from_stack", "frame_rate_derived"]
    tifffile.imwrite(tmp_path / "b.tif", FRAMES, imagej=True, metadata={"axes": "TYX", "fps": 7.0})
    time_s, (said,) = times(tmp_path / "b.tif", 50.0)
    assert said.code == "times_from_setup"
    assert np.allclose(time_s, 0.02 * np.arange(20))
    with pytest.raises(RecordingError, match=r"frame rate is unknown"):
        times(tmp_path / "b.tif")


def test_an_interval_of_a_second_is_of_programs_that_do_not_know_it(tmp_path):
    told = {"axes": "TYX", "finterval": 1.0}
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, imagej=True, metadata=told)
    time_s, (said,) = times(tmp_path / "a.tif", 50.0)
    assert np.allclose(time_s, 0.02 * np.arange(20))
    assert said.severity == "caution"
    assert "interval of 1 s, which programs write that do not know" in said.message
    with pytest.raises(RecordingError, match=r"frame rate is unknown.* of 1 s"):
        times(tmp_path / "a.tif")
    assert np.allclose(times(tmp_path / "a.tif", 1.0)[0], np.arange(20))


def pages_with(path, tags, frames=FRAMES):
    with tifffile.TiffWriter(path) as writer:
        for k, image in enumerate(frames):
            writer.write(image, contiguous=False, **GREY, **tags(k))


def test_times_of_micromanager(tmp_path):
    def tags(k):
        told = f'{{"ElapsedTime-ms": {1000 + 10.0 * k + (k % 4 == 1)}, "Camera": "a"}}'
        return {"extratags": [(51123, "s", 0, told, True)]}

    pages_with(tmp_path / "a.tif", tags)
    time_s, notices = times(tmp_path / "a.tif", 100.0)
    assert np.allclose(time_s, 0.01 * np.arange(20) + 0.001 * (np.arange(20) % 4 == 1))
    assert "ElapsedTime" in notices[0].message


def test_times_of_pages_need_fractions_of_a_second(tmp_path):
    start = datetime.datetime(2026, 2, 28, 23, 59, 59, 900000)

    def stamped(form):
        def tags(k):
            when = start + datetime.timedelta(seconds=0.05 * k)
            return {"datetime": False, "extratags": [(306, "s", 0, when.strftime(form), True)]}

        return tags

    pages_with(tmp_path / "a.tif", stamped("%Y:%m:%d %H:%M:%S.%f"))
    time_s, (said,) = times(tmp_path / "a.tif", 20.0)
    assert np.allclose(time_s, 0.05 * np.arange(20), atol=1e-6)
    assert "DateTime" in said.message
    pages_with(tmp_path / "b.tif", stamped("%Y:%m:%d %H:%M:%S"))
    assert open_stack(tmp_path / "b.tif").stamps is None


@pytest.mark.parametrize(
    ("elapsed", "why"),
    [
        ([0, 10, 20, 20, 40], "repeat (first at frame 4)"),
        ([0, 10, 5, 20, 40], "go backward (first at frame 3)"),
        ([0, 10, None, 30, 40], "1 of 5 are missing"),
    ],
)
def test_stamps_that_are_no_clock_are_not_used_and_said_to_be(tmp_path, elapsed, why):
    def tags(k):
        told = "{}" if elapsed[k] is None else f'{{"ElapsedTime-ms": {elapsed[k]}}}'
        return {"extratags": [(51123, "s", 0, told, True)]}

    pages_with(tmp_path / "a.tif", tags, FRAMES[:5])
    stack = open_stack(tmp_path / "a.tif")
    assert stack.stamps is None
    (said,) = stack.notices
    assert said.code == "stamps_not_used"
    assert why in said.message


# ------------------------------------------------------------------ what is refused


def refused(path, match):
    with pytest.raises(RecordingError, match=match) as caught:
        everything(open_stack(path))
    assert path.name in str(caught.value) or path.is_dir()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_colour_and_palette_and_channels_and_planes(tmp_path):
    rgb = np.zeros((3, 8, 9, 3), np.uint8)
    tifffile.imwrite(tmp_path / "rgb.tif", rgb, photometric="rgb", metadata=None)
    refused(tmp_path / "rgb.tif", r"page 1: is a colour image \(3 values per pixel\)")
    palette = np.zeros((3, 256), np.uint16)
    tifffile.imwrite(
        tmp_path / "p.tif", rgb[..., 0], photometric="palette", colormap=palette, metadata=None
    )
    refused(tmp_path / "p.tif", r"colour image \(palette\)")
    many = np.zeros((4, 2, 8, 9), np.uint8)
    tifffile.imwrite(tmp_path / "c.tif", many, imagej=True, metadata={"axes": "TCYX"})
    refused(tmp_path / "c.tif", "has 2 channels")
    tifffile.imwrite(tmp_path / "c.ome.tif", many, metadata={"axes": "TCYX"})
    refused(tmp_path / "c.ome.tif", "has 2 channels")
    tifffile.imwrite(tmp_path / "z.tif", many, imagej=True, metadata={"axes": "TZYX"})
    refused(tmp_path / "z.tif", "has 2 focal planes")
    tifffile.imwrite(tmp_path / "bits.tif", rgb[..., 0] > 0, **GREY)
    refused(tmp_path / "bits.tif", "no grey image")


def test_planes_alone_are_frames_with_a_notice(tmp_path):
    tifffile.imwrite(tmp_path / "z.tif", FRAMES, imagej=True, metadata={"axes": "ZYX"})
    stack = open_stack(tmp_path / "z.tif")
    assert [n.code for n in stack.notices] == ["planes_as_frames"]
    assert np.array_equal(everything(stack), FRAMES)


def test_pages_that_differ(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        writer.write(FRAMES[:3], **GREY)
        writer.write(FRAMES[3, :30], **GREY)
    refused(tmp_path / "a.tif", r"page 4: has 40 x 30 pixels of 16 bit, page 1 has 40 x 32")
    folder = tmp_path / "series"
    folder.mkdir()
    tifffile.imwrite(folder / "1.tif", FRAMES[0], **GREY)
    tifffile.imwrite(folder / "2.tif", FRAMES[1].astype(np.uint8), **GREY)
    refused(folder, r"2\.tif: has 40 x 32 pixels of 8 bit, 1\.tif has 40 x 32 pixels of 16 bit")


@pytest.mark.parametrize("options", [GREY, {**GREY, "compression": "zlib"}, {"imagej": True}])
def test_truncated_anywhere_is_never_a_shorter_film(tmp_path, options, caplog):
    path = tmp_path / "whole.tif"
    with tifffile.TiffWriter(path, imagej="imagej" in options) as writer:
        if "imagej" in options:
            writer.write(FRAMES, metadata={"axes": "TYX"})
        else:
            for image in FRAMES:
                writer.write(image, contiguous=False, **options)
    whole = path.read_bytes()
    cut = tmp_path / "cut.tif"
    told = []
    for share in np.linspace(0.001, 0.999, 60):
        cut.write_bytes(whole[: int(share * len(whole))])
        try:
            # what is missing may be what follows the last pixel
            assert np.array_equal(everything(open_stack(cut)), FRAMES)
        except RecordingError as error:
            told.append(str(error))
    assert len(told) > 50
    assert all("cut.tif" in message for message in told)
    assert not caplog.records
    assert not logging.getLogger("tifffile").filters


def test_damage_inside_a_compressed_page_names_the_page(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, compression="zlib", **GREY)
    with tifffile.TiffFile(tmp_path / "a.tif") as tif:
        offset = tif.pages[7].dataoffsets[0]
    content = bytearray((tmp_path / "a.tif").read_bytes())
    content[offset : offset + 40] = b"\xff" * 40
    (tmp_path / "a.tif").write_bytes(bytes(content))
    refused(tmp_path / "a.tif", r"a\.tif, page 8: cannot be decoded")


def test_empty_pages_and_files_and_single_frames(tmp_path):
    tifffile.imwrite(tmp_path / "one.tif", FRAMES[0], **GREY)
    refused(tmp_path / "one.tif", "has one frame, and motion takes at least two")
    (tmp_path / "empty.tif").write_bytes(b"")
    refused(tmp_path / "empty.tif", "is empty")
    (tmp_path / "text.tif").write_text("time_s,a\n")
    refused(tmp_path / "text.tif", "is no TIFF file")
    (tmp_path / "head.tif").write_bytes((tmp_path / "one.tif").read_bytes()[:8])
    refused(tmp_path / "head.tif", "is cut off or damaged after page 0")
    refused(tmp_path / "absent.tif", "there is no such file or folder")
    refused(tmp_path / "absent_*.tif", "no file has a name of this pattern")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "._a.tif").write_bytes(b"written by macOS")
    refused(tmp_path / "folder", "the folder has no TIFF files")
    path = tmp_path / "hole.tif"
    pages_with(path, lambda k: {})
    with tifffile.TiffFile(path, mode="r+b") as tif:
        tif.pages[4].tags["StripByteCounts"].overwrite([0])
    refused(path, r"hole\.tif, page 5: is empty: it has a header but no pixels")


def test_a_film_that_grows_while_it_is_read(tmp_path):
    path = tmp_path / "a.tif"
    pages_with(path, lambda k: {})
    stack = open_stack(path)
    chunks = stack.chunks(4)
    next(chunks)
    with tifffile.TiffWriter(path, append=True) as writer:
        writer.write(FRAMES[0], **GREY)
    with pytest.raises(RecordingError, match=r"a\.tif: grew by \d+ bytes while it was read"):
        list(chunks)
    path.unlink()
    with pytest.raises(RecordingError, match=r"a\.tif: cannot be read any more"):
        check_unchanged(stack.files[0])


def test_memory_does_not_grow_with_the_length(tmp_path):
    image = np.zeros((256, 256), np.uint16)

    def peak(frames):
        path = tmp_path / f"{frames}.tif"
        with tifffile.TiffWriter(path) as writer:
            for _ in range(frames):
                writer.write(image, contiguous=False, **GREY)
        tracemalloc.start()
        try:
            stack = open_stack(path)
            assert sum(len(chunk) for chunk in stack.chunks()) == frames
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    chunk = 128 * image.nbytes
    short, long = peak(200), peak(1000)
    # a chunk in use and the next being filled; of 800 frames more, no trace beyond their offsets
    assert short < 2.2 * chunk
    assert long - short < 800 * 500
