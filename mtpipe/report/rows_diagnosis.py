"""What the report shows of the diagnosis: the verdict, its sentences, forces before and after."""

from __future__ import annotations

from dataclasses import dataclass

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
class DiagnosisRows:
    """A bead's diagnosis; `sentence` is empty where there is none."""

    sentence: str
    effects: tuple[str, ...]
    forces: tuple[ForceRow, ...]


def diagnosis_rows(run: RunFolder, bead: str) -> DiagnosisRows:
    """The diagnosis of a bead; forces only where effects are named."""
    found = run.mismatch["beads"].get(bead)
    if found is None:
        return DiagnosisRows("", (), ())
    effects = tuple(f"{one['effect']}: {one['sentence']}" for one in found["effects"])
    forces = tuple(
        ForceRow(
            row["plateau"],
            "—" if row["magnet_mm"] is None else f"{row['magnet_mm']:.3f}",
            _with_error(row["force_before_pN"], row["stderr_before_pN"]),
            _with_error(row["force_pN"], row["stderr_pN"]),
            _change(row["force_before_pN"], row["force_pN"]),
        )
        for row in found["forces"]
        if effects
    )
    return DiagnosisRows(VERDICTS[found["verdict"]], effects, forces)


def _with_error(value: float | None, error: float | None) -> str:
    return "—" if value is None or error is None else f"{value:.3g} ± {error:.2g}"


def _change(before: float | None, after: float | None) -> str:
    return "—" if not before or after is None else f"{after / before - 1:+.1%}"
