"""Readers of films and look-up tables."""

from __future__ import annotations

import io
import json
import logging
from collections.abc import Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from case import Case, Reader, Step
from damage import damaged
from odd import NAMES, Random, array_of, odd_array, odd_value, pick
from readers_arrays import npy, npz

from mtpipe.tracking.lookup_table import LookUpTable
from mtpipe.tracking.matching import ring_count
from mtpipe.tracking.stack import open_stack
from mtpipe.tracking.stack_look import Reading

logging.getLogger("tifffile").setLevel(logging.CRITICAL)
FRAMES, HEIGHT, WIDTH = 5, 12, 16
REGION_PX, PLANES = 16, 8
UUID = "00000000-0000-0000-0000-000000000000"

# ------------------------------------------------------------------ films


def tiff(frames: Any, **options: Any) -> bytes:
    """A TIFF file."""
    stream = io.BytesIO()
    kind = {key: options.pop(key) for key in ("bigtiff", "imagej", "ome", "byteorder", "shaped")
            if key in options}  # fmt: skip
    tifffile.imwrite(stream, frames, **kind, **options)
    return stream.getvalue()


def frames_of(dtype: str = "u1", frames: int = FRAMES) -> np.ndarray[Any, Any]:
    """Grey images."""
    values = np.random.default_rng(0).integers(1, 200, (frames, HEIGHT, WIDTH))
    return values.astype(dtype)


@cache
def film_seeds() -> list[Case]:
    """TIFF, BigTIFF, ImageJ, OME, tifffile's own, packed, tiled, and a series of two files."""
    grey = {"photometric": "minisblack", "metadata": None}
    films = [
        tiff(frames_of(), **grey),
        tiff(frames_of("u2"), bigtiff=True, **grey),
        tiff(frames_of("u2"), byteorder=">", **grey),
        tiff(frames_of(), imagej=True, metadata={"axes": "TYX", "finterval": 0.01}),
        tiff(
            frames_of("u2"), ome=True, metadata={"axes": "TYX", "SignificantBits": 12, "UUID": UUID}
        ),
        tiff(frames_of("f4")),
        tiff(frames_of(), compression="zlib", predictor=True, **grey),
        tiff(frames_of(), compression="lzw", rowsperstrip=3, **grey),
        tiff(frames_of(), compression="packbits", **grey),
        tiff(frames_of(), compression="jpeg", **grey),
        tiff(frames_of("u2"), tile=(16, 16), compression="zstd", **grey),
        tiff(frames_of(), **grey, datetime="2026:01:01 00:00:00", description="t=1"),
    ]
    series = {f"film_{k}.tif": tiff(frames_of(frames=1), **grey) for k in (1, 2)}
    return [*(Case({"film.tif": film}, "film.tif") for film in films), Case(series, ".")]


def odd_film(random: Random) -> Case:
    """Other types and shapes, descriptions, tags, and pages that differ."""
    stream = io.BytesIO()
    style = pick(random, ("plain", "plain", "imagej", "ome", "shaped"))
    kind = {"imagej": style == "imagej", "ome": style == "ome", "bigtiff": bool(random.integers(2))}
    if style == "imagej":
        kind["bigtiff"] = False
    try:
        with tifffile.TiffWriter(stream, **kind) as writer:
            for _ in range(int(random.integers(1, 3))):
                writer.write(_odd_images(random), **_odd_options(random, style))
    except Exception:  # what tifffile does not write
        return film_seeds()[0].with_content(damaged(film_seeds()[0].files["film.tif"], random))
    return Case({"film.tif": stream.getvalue()}, "film.tif")


def _odd_images(random: Random) -> np.ndarray[Any, Any]:
    shape = pick(
        random,
        (
            (5, 12, 16),
            (5, 12, 16),
            (1, 12, 16),
            (12, 16),
            (5, 1, 1),
            (2, 3, 12, 16),
            (5, 12, 16, 3),
            (2, 0, 16),
            (300, 2, 2),
        ),
    )
    return array_of(
        random, pick(random, ("u1", "u2", "u4", "i2", "f4", "f8", "?", "c8", "u8", "f2")), shape
    )


def _odd_options(random: Random, style: str) -> dict[str, Any]:
    options: dict[str, Any] = {}
    if style == "plain":
        options["metadata"] = None
        options["description"] = pick(
            random,
            ("", "ImageJ=1.53\nimages=1000000000000\n", "ImageJ=1.53\nimages=-1\n",
             "ImageJ=\nimages=nan\nfinterval=x\n", '{"shape": [5, 12, 16]}',
             '{"shape": [1e9, 1e9]}',
             '{"shape": "x"}', '{"shape": [-1, 12, 16]}', "<OME></OME>", "<OME",
             "<?xml version='1.0'?>"
             '<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image><Pixels '
             'SizeX="9999999" SizeY="1" SizeT="0" SizeC="x" Type="uint8" DimensionOrder="XYZCT">'
             '<TiffData/></Pixels></Image></OME>', "t=nan", "a\nb", "time_s=1e400"),
        )  # fmt: skip
    elif style == "ome":
        options["metadata"] = {"UUID": UUID}
    elif style == "imagej":
        options["metadata"] = {pick(random, ("finterval", "fps", "unit", "Info", "axes", "min")):
                               pick(random, (0.01, -1, "TYX", "x\ny", "nan"))}  # fmt: skip
    if random.random() < 0.5:
        options["photometric"] = pick(random, ("minisblack", "miniswhite", "rgb", "cfa"))
    if random.random() < 0.3:
        options["compression"] = pick(random, ("zlib", "lzw", "zstd", "packbits", "jpeg"))
    if random.random() < 0.3:
        options["datetime"] = pick(random, ("2026:01:01 00:00:00", "0000:00:00 00:00:00"))
    if random.random() < 0.3:
        options["extratags"] = [
            (
                pick(random, (65000, 270, 306, 34361, 50839)),
                "s",
                0,
                pick(random, NAMES).encode("ascii", "replace").decode(),
                True,
            )
        ]
    return options


def film_steps(path: Path, case: Case) -> Iterator[Step]:
    """Looking at a film, and reading its frames."""
    for channels in (False, True):
        yield partial(_every_frame, path, Reading(channels, case.options["take"]))


def _every_frame(path: Path, reading: Reading) -> None:
    for chunk in open_stack(path, reading=reading).chunks():
        chunk.max(initial=0)


# ------------------------------------------------------------------ look-up tables

METADATA = {
    "schema": "mtpipe.lookup_table/1", "bead": "b1", "region_size_px": REGION_PX,
    "pixel_size_nm": 100.0, "method": "radial", "refractive_index_factor": 0.88,
    "scanned_nm": [0.0, 700.0], "source": "scan.tif", "made": "2026-01-01",
}  # fmt: skip


def lut(*, packed: bool, metadata: Any = None, arrays: Mapping[str, Any] | None = None) -> bytes:
    """A look-up table as mtpipe saves it."""
    from mtpipe.tracking.measured import DEFAULT_METHOD

    stated = METADATA | {"method": DEFAULT_METHOD} if metadata is None else metadata
    rings = ring_count(REGION_PX)
    profiles = np.cos(np.add.outer(np.arange(PLANES) / 3, np.arange(rings))) * 50 + 100
    content = {
        "z_nm": np.arange(PLANES) * 100.0,
        "profiles": profiles,
        "noise": np.full(PLANES, 0.01),
        "metadata": np.array(json.dumps(stated)),
    }
    content |= arrays or {}
    return npz({name: npy(a) for name, a in content.items() if a is not None}, packed=packed)


@cache
def lut_seeds() -> list[Case]:
    """A table, packed and not."""
    return [Case({"lut.npz": lut(packed=packed)}, "lut.npz") for packed in (False, True)]


def odd_lut(random: Random) -> Case:
    """Other arrays and metadata; members damaged within the archive."""
    packed, way = bool(random.integers(2)), random.integers(4)
    if way == 0:
        metadata = METADATA | {pick(random, list(METADATA)): odd_value(random)}
        return Case({"lut.npz": lut(packed=packed, metadata=metadata)}, "lut.npz")
    if way == 1:
        metadata = pick(random, (odd_value(random), None, [METADATA], dict.fromkeys(METADATA)))
        return Case({"lut.npz": lut(packed=packed, metadata=metadata or {})}, "lut.npz")
    if way == 2:
        name = pick(random, ("z_nm", "profiles", "noise", "metadata"))
        array = odd_array(random) if random.random() < 0.9 else None
        return Case({"lut.npz": lut(packed=packed, arrays={name: array})}, "lut.npz")
    members = {name: npy(np.zeros(8)) for name in ("z_nm", "profiles", "noise", "metadata")}
    members = {name: damaged(content, random) for name, content in members.items()}
    return Case({"lut.npz": npz(members, packed=packed)}, "lut.npz")


def lut_steps(path: Path, case: Case) -> Iterator[Step]:
    """Loading a table and holding images of its size against it."""
    yield lambda: LookUpTable.load(path).check_region(REGION_PX)


READERS = (
    Reader("film", film_seeds, odd_film, film_steps),
    Reader("lut", lut_seeds, odd_lut, lut_steps),
)
