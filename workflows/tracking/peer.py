"""trackpy on the study's images, in an environment of its own that is made on first use."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import peer_environment

PEER = Path(__file__).parent / "trackpy_peer"
REQUIREMENTS = PEER / "requirements.txt"
# What is searched, pixels; uneven, as trackpy wants them.
DIAMETERS_PX = (7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 31)
# A feature further from the bead than this is another one.
FOUND_PX = 1.0


@dataclass(frozen=True)
class Answer:
    """What trackpy says with the setting that finds most beads, and of those is nearest.

    `xy_px` (n, 2), NaN where it found another feature or none; `setting` in words.
    """

    xy_px: np.ndarray
    setting: str
    cpu_s: float


def environment(folder: Path) -> Path:
    """Python interpreter of a virtual environment with trackpy, made in a folder if need be."""
    return peer_environment.environment(folder, REQUIREMENTS)


def locate(
    python: Path,
    images: np.ndarray,
    truth_px: np.ndarray,
    diameters_px: Sequence[int] = DIAMETERS_PX,
) -> Answer:
    """Where trackpy finds the bead in images (n, size, size), its best setting chosen by truth."""
    with tempfile.TemporaryDirectory(prefix="mtpipe-study-") as name:
        asked, answered = Path(name) / "images.npz", Path(name) / "answers.npz"
        np.savez(asked, images=images, diameters_px=diameters_px)
        done = subprocess.run(
            [str(python), str(PEER / "locate.py"), str(asked), str(answered)],
            capture_output=True,
            text=True,
        )
        if done.returncode:
            raise RuntimeError(f"trackpy_peer/locate.py failed:\n{done.stderr}")
        with np.load(answered) as answers:
            xy, cpu_s, settings = answers["xy_px"], answers["cpu_s"], answers["settings"]
    away = np.hypot(*np.moveaxis(xy - truth_px, 2, 0))
    found = away < FOUND_PX
    rms = [
        np.sqrt(np.mean(a[f] ** 2)) if f.any() else np.inf for a, f in zip(away, found, strict=True)
    ]
    best = min(range(len(xy)), key=lambda i: (-found[i].sum(), rms[i]))
    diameter, dark = settings[best]
    return Answer(
        np.where(found[best][:, None], xy[best], np.nan),
        f"{diameter} px, {'dark' if dark else 'bright'}",
        float(cpu_s[best]),
    )
