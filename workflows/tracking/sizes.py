"""Table of what the size of a region does: the default before and now, magtrack alone, trackpy."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import magtrack
import numpy as np
import peer
import pictures
from accuracy import nm, rms
from pages import table

from mtpipe.simulation.bead_image import BeadImage, BeadOptics
from mtpipe.simulation.images import draw
from mtpipe.tracking.find_beads import find_beads
from mtpipe.tracking.follow import corner, cut
from mtpipe.tracking.positions import locate
from mtpipe.tracking.precision import precision_nm
from mtpipe.tracking.region_sizes import sized

# A bead of 1 µm and one of 2.8 µm, nearer to the focus and further.
BEADS = {
    "0.5 µm, 3 µm from focus": BeadOptics(500.0, pictures.PIXEL_NM, 3000.0, reach_px=90),
    "1.4 µm, 3 µm from focus": BeadOptics(1400.0, pictures.PIXEL_NM, 3000.0, reach_px=90),
    "1.4 µm, 5 µm from focus": BeadOptics(1400.0, pictures.PIXEL_NM, 5000.0, reach_px=90),
}
BACKGROUND_E = 1600.0
PICTURE_PX, HEIGHT_NM = 201, 100.0
DIAMETERS_PX = (21, 41, 61, 81)
FOR_TRACKPY = 40  # images; it takes its time with large diameters
MAGTRACK_PX = (41, 61, 81, 101, 121, 151, 201)


def sizes_table(python: Path, images: int) -> str:
    """Root-mean-square errors of x and y with each default, and what is stated over the scatter."""
    lines = [_line(python, images, name) for name in BEADS]
    return table(
        "bead's radius, height | signal/noise | region before (px) | x, y | region now (px) | x, y"
        " | stated / scatter now | magtrack by itself x, y | with (px) | trackpy x, y | with",
        lines,
    )


def _line(python: Path, images: int, name: str) -> list[str]:
    camera = replace(pictures.sensor(BACKGROUND_E), flicker=0.0)
    middle = (PICTURE_PX - 1) / 2
    random = np.random.default_rng(600)
    xy = middle + random.uniform(-1, 1, (images, 2))
    stack = _film(name, camera, xy, seed=601)
    still = _film(name, camera, np.tile([middle + 0.2, middle - 0.3], (2 * images, 1)), seed=602)
    before = find_beads(stack[:50].astype(float))
    now, _ = sized(before, stack[:50].astype(float), None)
    cells = [name, f"{pictures.signal_to_noise(camera):.0f}"]
    for (region,) in (before.regions, now.regions):
        row, column = corner(region, (PICTURE_PX, PICTURE_PX))
        found = locate(cut(stack, region))
        error = np.column_stack([found.x_px + column, found.y_px + row]) - xy
        cells += [f"{region.size_px}", nm(rms(pictures.PIXEL_NM * error))]
    at_rest = cut(still, now.regions[0])
    found = locate(at_rest)
    scatter = pictures.PIXEL_NM * np.std([found.x_px, found.y_px], axis=1)
    parts = enumerate(np.array_split(at_rest, 3))
    each = [precision_nm(part, pictures.PIXEL_NM, seed=seed)[:2] for seed, part in parts]
    stated = np.median(each, axis=0)
    cells.append(", ".join(f"{s:.2f}" for s in stated / scatter))
    by_size = {size: _by_magtrack(stack, xy, size) for size in MAGTRACK_PX}
    best = min(by_size, key=lambda size: by_size[size])
    its = peer.locate(python, stack[:FOR_TRACKPY], xy[:FOR_TRACKPY], DIAMETERS_PX)
    missed = pictures.PIXEL_NM * (its.xy_px - xy[:FOR_TRACKPY])
    return [*cells, nm(by_size[best]), f"{best}", nm(rms(missed)), its.setting]


@functools.cache
def _bead(name: str) -> BeadImage:
    return BeadImage.of(BEADS[name], 0.0, 2 * HEIGHT_NM)


def _film(name: str, camera: pictures.Sensor, xy: np.ndarray, seed: int) -> np.ndarray:
    places = np.column_stack([xy, np.full(len(xy), HEIGHT_NM)])
    shape = (PICTURE_PX, PICTURE_PX)
    return draw(_bead(name), camera, places, shape, np.random.default_rng(seed))


def _by_magtrack(stack: np.ndarray, xy: np.ndarray, size_px: int) -> float:
    """Error of magtrack's own pipeline, in nm, in the middle of the picture."""
    first = (PICTURE_PX - size_px) // 2
    piece = stack[:, first : first + size_px, first : first + size_px].astype(float)
    x, y, *_ = magtrack.stack_to_xyzp(np.moveaxis(piece, 0, 2))
    return rms(pictures.PIXEL_NM * (np.column_stack([x, y]) + first - xy))
