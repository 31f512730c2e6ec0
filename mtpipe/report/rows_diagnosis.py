"""What the report shows of the diagnosis: the verdict, its sentences, forces before and after."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mtpipe.report.folder import RunFolder

VERDICTS = {
    "consistent": "The recording is what the configured experiment would give.",
    "explained": "The recording differs from the configured experiment, and the cause was found.",
    "unexplained": "The recording differs from the configured experiment, and what was tried does "
    "not explain it.",
}


@dataclass(frozen=True)
class ForceRow:
    """Force of a plateau as configured and with the effects named, as text."""

    plateau: int
    magnet: str
    before: str
    after: str
    change: str


@dataclass(frozen=True)
class BoundRow:
    """Force of a plateau as fitted, with the spectrum's correction free, and between, as text."""

    plateau: int
    magnet: str
    fitted: str
    corrected: str
    between: str


@dataclass(frozen=True)
class DiagnosisRows:
    """A bead's diagnosis; `sentence` is empty where there is none, `left` where nothing is left.

    `bounds`: forces with the correction of the spectrum free; none where there is none.
    """

    sentence: str
    left: str
    bounds: tuple[BoundRow, ...]
    effects: tuple[str, ...]
    forces: tuple[ForceRow, ...]


def diagnosis_rows(run: RunFolder, bead: str) -> DiagnosisRows:
    """The diagnosis of a bead; forces only where effects are named."""
    found = run.mismatch["beads"].get(bead)
    if found is None:
        return DiagnosisRows("", "", (), (), ())
    effects = tuple(f"{one['effect']}: {one['sentence']}" for one in found["effects"])
    forces = tuple(
        ForceRow(
            row["plateau"],
            _magnet(row),
            _with_error(row["force_before_pN"], row["stderr_before_pN"]),
            _with_error(row["force_pN"], row["stderr_pN"]),
            _change(row["force_before_pN"], row["force_pN"]),
        )
        for row in found["forces"]
        if effects
    )
    left = run.unexplained.get(bead, {"sentence": "", "correction": None})
    bounds = tuple(
        BoundRow(
            row["plateau"],
            _magnet(row),
            f"{row['force_pN']:.3g}",
            _with_error(row["corrected_pN"], row["corrected_stderr_pN"]),
            f"{row['low_pN']:.3g} – {row['high_pN']:.3g}",
        )
        for row in (left["correction"] or {"forces": ()})["forces"]
    )
    return DiagnosisRows(VERDICTS[found["verdict"]], left["sentence"], bounds, effects, forces)


def _magnet(row: Mapping[str, Any]) -> str:
    return "—" if row["magnet_mm"] is None else f"{row['magnet_mm']:.3f}"


def _with_error(value: float | None, error: float | None) -> str:
    return "—" if value is None or error is None else f"{value:.3g} ± {error:.2g}"


def _change(before: float | None, after: float | None) -> str:
    return "—" if not before or after is None else f"{after / before - 1:+.1%}"
