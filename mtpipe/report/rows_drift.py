"""Rows of the report's tables of drift: what was subtracted, and what became of the references."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mtpipe.report import words
from mtpipe.report.folder import RunFolder, records


def drift_rows(drift: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """(axis, cutoff, what was subtracted, noise added) of each axis."""
    none: Sequence[None] = (None, None, None)
    cutoffs = drift.get("cutoff_hz") or none
    removed = drift.get("drift_rms_nm") or none
    added = drift.get("noise_added_nm") or none
    return [
        (
            axis,
            "frame by frame" if cutoff is None else words.number(cutoff),
            words.number(rms),
            words.number(noise),
        )
        for axis, cutoff, rms, noise in zip("xyz", cutoffs, removed, added, strict=True)
    ]


def reference_rows(folder: RunFolder) -> list[dict[str, Any]]:
    """Reference beads: used or left out, with weight and noise per axis."""
    return [
        {
            "bead": row["bead"],
            "used": bool(row["used"]),
            "reason": words.text(row["reason"]),
            "weights": [words.number(row[f"weight_{axis}"], 2) for axis in "xyz"],
            "noises": [words.number(row[f"noise_{axis}_nm"], 2) for axis in "xyz"],
        }
        for row in records(folder.references)
    ]
