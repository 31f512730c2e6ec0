"""Bead images that other laboratories took: is what the tracker says of them consistent?

Nobody knows where these beads were. The focus scan of one bead is judged by itself: a look-up table
is built from every other image, and the images between are tracked with it; their focus is known
from the scan. The single images are cut out again at other places: the bead must stay where it is.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from accuracy import nm
from pages import table

from mtpipe.ground.errors import RecordingError
from mtpipe.tracking.lookup_table import LookUpTable
from mtpipe.tracking.measured import DEFAULT_METHOD, METHODS
from mtpipe.tracking.positions import locate
from mtpipe.tracking.precision import precision_nm

SIDE_PX = 100
# The images' focus, in mm, of `data_153` at its two ends (the file in between is not read).
SECOND_SCAN_NM = (25_000.0, 65_000.0)
# 8-bit raw squares, of which no more is known.
SINGLE = ("j_singlebead.bin",)


def scan_table(folder: Path) -> str:
    """The focus scan `data_024ROI.bin`: tables from every 2nd, 4th image track the others."""
    images, focus = first_scan(folder)
    lines = []
    for method in ("auto_conv_multiline", "magtrack"):
        for every in (2, 4):
            known = np.arange(len(images)) % every == 0
            lut = _table(images[known], focus[known], "data_024ROI.bin", method)
            found = locate(images[~known], method=method, table=lut)
            error = found.z_nm - focus[~known]
            halves = [np.nanstd(half) for half in np.array_split(error, 2)]
            stated = precision_nm(images[~known], 1.0, method, lut)
            lines.append([
                f"`{method}`", f"{np.median(np.diff(lut.z_nm)):.0f}", str(len(lut.z_nm)),
                f"{int(np.sum(found.lost > 0))} of {len(error)}",
                f"{np.nanmean(error):+.1f}", nm(float(halves[0])), nm(float(halves[1])),
                nm(float(stated[2])), f"{np.nanmin(found.quality):.4f}",
            ])  # fmt: skip
    return table(
        "method | planes every (nm) | planes | lost | mean error z (nm) | standard deviation"
        " in the first half | in the second | precision stated from noise | lowest quality",
        lines,
    )


def lateral_table(folder: Path) -> str:
    """x and y in that scan: jitter from image to image, beside the noise the images show."""
    images, _ = first_scan(folder)
    lines = []
    for method in METHODS:
        found = locate(images, method=method)
        jitter = [_third(found.x_px), _third(found.y_px)]
        stated = precision_nm(images, 1.0, method)
        lines.append([
            f"`{method}`", str(int(np.sum(found.lost > 0))),
            *(f"{value:.3f}" for value in (*jitter, *stated[:2])),
        ])  # fmt: skip
    common = locate(images, method=DEFAULT_METHOD)
    other = locate(images, method="auto_conv")
    apart = [np.std(common.x_px - other.x_px), np.std(common.y_px - other.y_px)]
    return table("method | lost | jitter x (px) | y | noise stated x (px) | y", lines) + (
        f"\n\n`auto_conv_multiline` and `auto_conv` differ by {apart[0]:.3f} px in x and "
        f"{apart[1]:.3f} px in y (standard deviation over the images)."
    )


def others_table(folder: Path) -> str:
    """The scan through focus, and single images."""
    lines = []
    raw = np.fromfile(folder / "vannoort-stacks" / "data_153.bin", np.uint8)
    images = raw.reshape(-1, SIDE_PX, SIDE_PX)
    focus = np.linspace(*SECOND_SCAN_NM, len(images))
    found = locate(images)
    try:
        lut = _table(images, focus, "data_153.bin", DEFAULT_METHOD)
        said = " ".join(notice.message for notice in lut.notices) or "kept whole"
    except RecordingError as error:
        said = str(error)
    lost = int(np.sum(found.lost > 0))
    lines.append(["data_153.bin", f"{len(images)}", str(lost), _span(found.quality), said])
    for name in SINGLE:
        image = np.fromfile(folder / "qtrk-images" / name, np.uint8)
        side = round(np.sqrt(image.size))
        image = image.reshape(side, side)
        moved = [image[r : side - 8 + r, c : side - 8 + c] for r in range(9) for c in range(9)]
        found = locate(np.array(moved))
        at = np.array([[c, r] for r in range(9) for c in range(9)])
        place = np.column_stack([found.x_px, found.y_px]) + at
        lost = int(np.sum(found.lost > 0))
        x, y = np.nanmean(place, axis=0)
        scatter = np.nanstd(place, axis=0)
        said = (
            f"cut out at {len(at)} places: x = {x:.3f} ± {scatter[0]:.3f} px, "
            f"y = {y:.3f} ± {scatter[1]:.3f} px"
        )
        lines.append([name, "1", str(lost), _span(found.quality), said])
    return table("file | images | lost | quality | look-up table, or place", lines)


def first_scan(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Images (251, 100, 100) of `data_024ROI.bin` and their focus in nm."""
    from nptdms import TdmsFile

    stacks = folder / "vannoort-stacks"
    images = np.fromfile(stacks / "data_024ROI.bin", np.uint8).reshape(-1, SIDE_PX, SIDE_PX)
    channels = [c for g in TdmsFile.read(stacks / "data_024.tdms").groups() for c in g.channels()]
    focus_mm = next(c[:] for c in channels if c.name == "Focus (mm)")
    return images, 1e6 * np.asarray(focus_mm, dtype=float)


def _table(images: np.ndarray, focus: np.ndarray, name: str, method: str) -> LookUpTable:
    return LookUpTable.build(
        images,
        focus,
        bead="1",
        refractive_index_factor=1.0,
        pixel_size_nm=None,
        stack=name,
        method=method,
    )


def _third(values: np.ndarray) -> float:
    """Standard deviation of white noise with the same second differences."""
    return float(np.nanstd(np.diff(values, 2)) / np.sqrt(6))


def _span(values: np.ndarray) -> str:
    return f"{values.min():.2f} to {values.max():.2f}"
