"""A bead's tracking noise in words: by its spectra, beside what its images explain.

Read from `noise_floor_…` and `image_precision_…` of the run folder's `beads`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mtpipe.recording.recording import AXES
from mtpipe.report import words


def noise_sentence(bead: Mapping[str, Any]) -> str:
    """Noise by spectra and by images; empty where there are no images to compare with.

    Parameters
    ----------
    bead : row of `beads`.
    """
    compared = [
        f"{axis} {words.number(explained, 2)} nm by its images, {_floor(bead, axis)}"
        for axis in AXES
        if words.is_number(explained := bead[f"image_precision_{axis}_nm"])
    ]
    return f"Tracking noise: {'; '.join(compared)}." if compared else ""


def _floor(bead: Mapping[str, Any], axis: str) -> str:
    value, stderr, low, high = (
        bead[f"noise_floor_{axis}{part}_nm"] for part in ("", "_stderr", "_low", "_high")
    )
    if not words.is_number(value):
        return "not determined by its spectra"
    return f"{words.with_arms(value, stderr, low, high)} nm by its spectra"
