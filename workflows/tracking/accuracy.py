"""Tables of accuracy and speed on rendered images, each method beside trackpy."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import peer
import pictures
from pages import table

from mtpipe.simulation.images import Sensor
from mtpipe.tracking.measured import METHODS
from mtpipe.tracking.positions import Positions, locate
from mtpipe.tracking.precision import precision_nm

BACKGROUNDS_E = (100.0, 400.0, 1600.0, 6400.0, 25_600.0)
HEIGHTS_NM = np.arange(400.0, 2101.0, 200.0)
PHASES_PX = np.arange(-0.5, 0.5, 0.1)
STEPS_NM = (25.0, 50.0, 100.0, 200.0)
SIZES_PX = (48, 64, 96, 128)
NAMES = {
    "center_of_mass": "`center_of_mass`",
    "auto_conv": "`auto_conv`",
    "auto_conv_multiline": "`auto_conv_multiline` (default)",
    "magtrack": "`magtrack`",
}


def noise_table(python: Path, images: int) -> str:
    """Root-mean-square errors against the light, at any phase and height."""
    lines = []
    for i, background in enumerate(BACKGROUNDS_E):
        camera = pictures.sensor(background)
        truth = pictures.positions(images, seed=i)
        stack = pictures.images(truth, camera, seed=i)
        cells = [f"{pictures.signal_to_noise(camera):.0f}"]
        for method in METHODS:
            error = errors_nm(locate(stack, method=method, table=pictures.table(method)), truth)
            cells += [nm(rms(error[:, :2])), nm(rms(error[:, 2]))]
        lines.append([*cells, *by_trackpy(python, stack, truth)])
    names = " | ".join(f"{NAMES[method]} x, y | z" for method in METHODS)
    return table(f"signal/noise | {names} | trackpy x, y | found", lines)


def height_table(python: Path, images: int) -> str:
    """Bias and scatter at single heights, at any phase of the pixels."""
    lines = []
    for i, height in enumerate(HEIGHTS_NM):
        truth = pictures.positions(images, 100 + i, height, height)
        stack = pictures.images(truth, pictures.sensor(), seed=100 + i)
        own, its = (
            errors_nm(locate(stack, method=method, table=pictures.table(method)), truth)
            for method in ("auto_conv_multiline", "magtrack")
        )
        line = errors_nm(locate(stack, method="auto_conv"), truth)
        lines.append([
            f"{height:.0f}", nm(rms(own[:, :2])), nm(rms(line[:, :2])),
            biased(own[:, 2]), biased(its[:, 2]), *by_trackpy(python, stack, truth),
        ])  # fmt: skip
    return table(
        f"height (nm) | {NAMES['auto_conv_multiline']} x, y | `auto_conv` x, y | default z"
        " | `magtrack` z | trackpy x, y | found",
        lines,
    )


def phase_table(python: Path, images: int) -> str:
    """What the pixels do: mean errors with the bead at one place of a pixel and one height."""
    lines = []
    for i, phase in enumerate(PHASES_PX):
        truth = np.tile([phase, 0.23, 1230.0], (images, 1))
        stack = pictures.images(truth, pictures.sensor(), seed=200 + i)
        errors = {
            method: errors_nm(locate(stack, method=method, table=pictures.table(method)), truth)
            for method in METHODS
        }
        middle = (stack.shape[1] - 1) / 2
        its = peer.locate(python, stack, truth[:, :2] + middle).xy_px
        found = ~np.isnan(its[:, 0])
        mean = (its[found] - middle - truth[found, :2]).mean(axis=0) if found.any() else [np.nan]
        lines.append([
            f"{phase:+.1f}", *(f"{errors[method][:, 0].mean():+.2f}" for method in METHODS),
            f"{pictures.PIXEL_NM * mean[0]:+.2f}",
            f"{errors['auto_conv_multiline'][:, 2].mean():+.1f}",
            f"{errors['magtrack'][:, 2].mean():+.1f}",
        ])  # fmt: skip
    names = " | ".join(f"{NAMES[method]} x" for method in METHODS)
    return table(f"x in the pixel | {names} | trackpy x | default z | `magtrack` z", lines)


def planes_table(images: int) -> str:
    """Heights against the distance of the look-up table's planes, and with another bead's table."""
    truth = pictures.positions(images, seed=300, low_nm=650.0, high_nm=1850.0)
    stack = pictures.images(truth, pictures.sensor(), seed=300)
    lines = []
    for step in STEPS_NM:
        cells = [f"{step:.0f}"]
        for method in ("auto_conv_multiline", "magtrack"):
            found = locate(stack, method=method, table=pictures.table(method, step))
            cells.append(biased(errors_nm(found, truth)[:, 2]))
        lines.append(cells)
    for radius in (1.01, 1.03):
        cells = [f"50, of a bead {radius - 1:.0%} larger"]
        for method in ("auto_conv_multiline", "magtrack"):
            other = pictures.table(method, radius_nm=radius * pictures.RADIUS_NM)
            cells.append(biased(errors_nm(locate(stack, method=method, table=other), truth)[:, 2]))
        lines.append(cells)
    return table("planes every (nm) | default z | `magtrack` z", lines)


def precision_table(images: int) -> str:
    """The precision estimated from images, over the scatter of a bead at rest.

    As in a recording, it is the median of three estimates. The noise is another one in every cell.
    """
    lines = []
    for i, background in enumerate(BACKGROUNDS_E):
        camera = pictures.sensor(background)
        cells = [f"{pictures.signal_to_noise(camera):.0f}"]
        for j, height in enumerate((600.0, 1230.0, 1900.0)):
            truth = np.tile([0.2, -0.3, height], (images, 1))
            stack = pictures.images(truth, camera, seed=400 + 3 * i + j)
            lut = pictures.table("auto_conv_multiline")
            scatter = np.nanstd(errors_nm(locate(stack, table=lut), truth), axis=0)
            seeds = range(400 + 9 * i + 3 * j, 400 + 9 * i + 3 * j + 3)
            parts = np.array_split(stack, len(seeds))
            stated = np.median(
                [
                    precision_nm(part, pictures.PIXEL_NM, table=lut, seed=seed)
                    for part, seed in zip(parts, seeds, strict=True)
                ],
                axis=0,
            )
            cells += [
                f"{scatter[0]:.2f}, {scatter[2]:.2f}",
                ", ".join(f"{s / t:.2f}" for s, t in zip(stated, scatter, strict=True)),
            ]
        lines.append(cells)
    header = " | ".join(
        f"{h} nm: scatter x, z (nm) | estimated / scatter x, y, z" for h in (600, 1230, 1900)
    )
    return table(f"signal/noise | {header}", lines)


def speed_table(python: Path) -> str:
    """Bead-frames per second of CPU time on one core, z included; the best of three."""
    lines = []
    for size in SIZES_PX:
        truth = pictures.positions(512, seed=500)
        stack = pictures.images(truth, Sensor(), 500, size)
        cells = [f"{size} x {size}"]
        for method in METHODS:
            lut = pictures.table(method, size_px=size)
            locate(stack[:64], method=method, table=lut)
            seconds = []
            for _ in range(3):
                began = time.process_time()
                locate(stack, method=method, table=lut)
                seconds.append(time.process_time() - began)
            cells.append(f"{len(stack) / min(seconds):.0f}")
        middle = (size - 1) / 2
        its = peer.locate(python, stack[:128], truth[:128, :2] + middle)
        lines.append([*cells, f"{1 / its.cpu_s:.0f}"])
    names = " | ".join(NAMES[method] for method in METHODS)
    return table(f"region (px) | {names} | trackpy, x and y alone", lines)


def errors_nm(found: Positions, truth: np.ndarray) -> np.ndarray:
    """(n, 3) errors of x, y, z; NaN where lost. `truth` counts from the middle of 64 pixels."""
    px = np.column_stack([found.x_px, found.y_px]) - 31.5 - truth[:, :2]
    return np.column_stack([pictures.PIXEL_NM * px, found.z_nm - truth[:, 2]])


def by_trackpy(python: Path, stack: np.ndarray, truth: np.ndarray) -> list[str]:
    """Root-mean-square error of x and y, and how many beads were found with which setting."""
    middle = (stack.shape[1] - 1) / 2
    its = peer.locate(python, stack, truth[:, :2] + middle)
    error = pictures.PIXEL_NM * (its.xy_px - middle - truth[:, :2])
    found = np.mean(~np.isnan(error[:, 0]))
    return [nm(rms(error)), f"{found:.0%} ({its.setting})"]


def rms(error: np.ndarray) -> float:
    """Root mean square of the errors that are there; NaN without any."""
    there = error[~np.isnan(error)]
    return float(np.sqrt(np.mean(there**2))) if len(there) else float("nan")


def nm(value: float) -> str:
    """A length in nm, or a dash."""
    return "–" if np.isnan(value) else f"{value:.2f}" if value < 10 else f"{value:.0f}"


def biased(error: np.ndarray) -> str:
    """Mean and standard deviation."""
    return f"{np.nanmean(error):+.1f} ± {np.nanstd(error):.1f}"
