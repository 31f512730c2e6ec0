"""The demo: the whole pipeline on the bundled recordings, beside the truth that made them.

Every folder of `sample_data/` holds a setup.toml, a recording (`recording.*`, or files that the
setup's `[source]` names) and truth.json: per tethered bead what it is in words (`what`), and where
a tether holds it `force_pN`, one true force per plateau, beside other true values per plateau.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mtpipe
from mtpipe.bead_results import BeadResult
from mtpipe.errors import MtpipeError
from mtpipe.pipeline import Progress, Run, run


@dataclass(frozen=True)
class BeadScore:
    """One bead's forces beside the true ones.

    `true_pN` has one force per plateau (empty where no tether holds the bead), `relative_errors`
    one per lateral axis and plateau that gave a force, and `inside` counts the true forces within
    the stated 68 % intervals.
    """

    bead: str
    what: str
    verdict: str
    true_pN: tuple[float, ...]
    relative_errors: tuple[float, ...]
    inside: int


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


def recording_in(folder: Path) -> Path:
    """What `mtpipe run` is called with for a bundled recording: its file, or its setup."""
    return next(iter(sorted(folder.glob("recording.*"))), folder / "setup.toml")


def run_demo(out: Path, *, workers: int = 1, progress: Progress | None = None) -> str:
    """Run every bundled recording and compare its forces with the true ones.

    Returns
    -------
    Text: a table of true and measured forces, and where the reports are.
    """
    folders = sorted(setup.parent for setup in sample_data().glob("*/setup.toml"))
    lines = [_HEADINGS]
    reports = []
    inside = forces = 0
    for number, folder in enumerate(folders):
        label = f"{folder.name} ({number + 1}/{len(folders)})"
        result = run(
            recording_in(folder),
            out / folder.name,
            workers=workers,
            # it would double the time, and the truth is at hand
            cross_check=False,
            progress=_labelled(progress, label),
        )
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        for score in scores(result, truth):
            lines.append(_line(folder.name, score))
            inside += score.inside
            forces += len(score.relative_errors)
        reports.append(f"  {out / folder.name / 'report' / 'index.html'}")
    share = f"{inside} of {forces} true forces lie within the 68 % intervals of the measured ones."
    return "\n".join([*lines, "", share, "Reports:", *reports])


def scores(result: Run, truth: dict[str, Any]) -> Iterator[BeadScore]:
    """Compare the lateral forces of every calibrated bead with the content of truth.json."""
    verdicts = {verdict.bead: verdict.verdict for verdict in result.verdicts}
    for bead in result.calibration.beads:
        true = tuple(truth[bead.bead].get("force_pN", ()))
        errors, inside = _errors(bead, true) if true else ([], 0)
        what = truth[bead.bead]["what"]
        yield BeadScore(bead.bead, what, verdicts[bead.bead], true, tuple(errors), inside)


def _errors(bead: BeadResult, true_pN: tuple[float, ...]) -> tuple[list[float], int]:
    errors, inside = [], 0
    for plateau, true in zip(bead.plateaus, true_pN, strict=True):
        # a force that x and y share counts once
        lateral = [one for one in plateau.axes if one.force is not None]
        for one in lateral[:1] if all(one.shares_force for one in lateral) else lateral:
            force = one.force
            if force is None or not math.isfinite(force.value):
                continue
            errors.append(force.value / true - 1)
            inside += force.interval[0] <= true <= force.interval[1]
    return errors, inside


_HEADINGS = (
    f"{'recording':20s}{'bead':6s}{'verdict':9s}{'true force (pN)':17s}{'median error':14s}"
    f"{'in 68 %':11s}what it is"
)


def _line(recording: str, score: BeadScore) -> str:
    force = error = within = "-"
    if score.true_pN:
        force = f"{min(score.true_pN):.2f} to {max(score.true_pN):.2f}"
    if score.relative_errors:
        sizes = sorted(abs(e) for e in score.relative_errors)
        error = f"{sizes[len(sizes) // 2]:.1%}"
        within = f"{score.inside} of {len(sizes)}"
    return (
        f"{recording:20s}{score.bead:6s}{score.verdict:9s}{force:17s}{error:14s}{within:11s}"
        f"{score.what}"
    )


def _labelled(progress: Progress | None, label: str) -> Progress | None:
    if progress is None:
        return None
    return lambda step, done, total: progress(f"{label}: {step}", done, total)
