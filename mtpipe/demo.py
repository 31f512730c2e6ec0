"""The demo: the whole pipeline on the bundled recordings, beside the forces that made them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import mtpipe
from mtpipe.errors import MtpipeError
from mtpipe.pipeline import Progress, Run, run


def sample_data() -> Path:
    """Folder of the bundled recordings, in an installed wheel or in a checkout.

    Raises
    ------
    MtpipeError : neither is there.
    """
    package = Path(mtpipe.__file__).parent
    for folder in (package / "sample_data", package.parent / "sample_data"):
        if any(folder.glob("*/setup.toml")):
            return folder
    raise MtpipeError(
        "the bundled recordings are missing", mend="Install mtpipe again from its wheel."
    )


def run_demo(out: Path, *, workers: int | None = None, progress: Progress | None = None) -> str:
    """Run every bundled recording and compare its forces with the true ones.

    Returns
    -------
    Text: a table of true and measured forces, and where the reports are.
    """
    folders = sorted(setup.parent for setup in sample_data().glob("*/setup.toml"))
    lines = ["recording        bead  plateaus  true force (pN)   error of x (median)   in 68 %"]
    reports = []
    for number, folder in enumerate(folders):
        result = run(
            folder / "setup.toml" if _names_its_files(folder) else _recording_in(folder),
            out / folder.name,
            workers=workers,
            progress=_labelled(progress, f"{folder.name} ({number + 1}/{len(folders)})"),
        )
        lines += _compared(folder.name, result, json.loads((folder / "truth.json").read_text()))
        reports.append(f"  {out / folder.name / 'report' / 'index.html'}")
    return "\n".join([*lines, "", "Reports:", *reports])


def _names_its_files(folder: Path) -> bool:
    return not list(folder.glob("recording.*"))


def _recording_in(folder: Path) -> Path:
    return sorted(folder.glob("recording.*"))[0]


def _labelled(progress: Progress | None, label: str) -> Progress | None:
    if progress is None:
        return None
    inner: Callable[[str, int, int], None] = progress
    return lambda step, done, total: inner(f"{label}: {step}", done, total)


def _compared(name: str, result: Run, truth: dict[str, dict[str, list[float]]]) -> list[str]:
    """A line per bead; `truth` is bead → {"force_pN": one per plateau}."""
    along = ("x", "y", "z")[result.calibration.conditions.along]
    lines = []
    for bead in result.calibration.beads:
        true = truth[bead.bead]["force_pN"]
        errors, inside = [], 0
        for plateau, force in zip(bead.plateaus, true, strict=True):
            one = next(one.force for one in plateau.axes if one.axis == along)
            if one is None or not math.isfinite(one.value):
                continue
            errors.append(abs(one.value / force - 1))
            inside += one.interval[0] <= force <= one.interval[1]
        middle = f"{sorted(errors)[len(errors) // 2]:.1%}" if errors else "-"
        lines.append(
            f"{name:15s}  {bead.bead:4s}  {len(errors)} of {len(true):2d}   "
            f"{min(true):6.2f} to {max(true):5.2f}   {middle:>19s}   {inside} of {len(errors)}"
        )
    return lines
