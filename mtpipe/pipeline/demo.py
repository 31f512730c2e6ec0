"""The demo: the whole pipeline on some of the bundled recordings, beside the truth that made them.

A folder of `sample_data/` holds a setup.toml, a recording (`recording.*`, or files that the setup's
`[source]` names) and truth.json: per tethered bead what it is in words (`what`), and where a tether
holds it `force_pN`, one true force per plateau, beside other true values per plateau. Of the
concealed ones, whose setups are silent about something, `concealed/answers` has the truth; it is
opened when the recording has been diagnosed.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mtpipe.calibration.recommended_force import BeadForces
from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.types import NamedProgress
from mtpipe.pipeline.results import Run
from mtpipe.pipeline.run import run


@dataclass(frozen=True)
class Sample:
    """A bundled recording, and whether it is cross-checked and diagnosed."""

    folder: str
    cross_check: bool


# A field of view with sound and bad beads; a recording that is what its setup says; one that is
# not. Cross-checks are of the short ones, so that the whole takes less than a minute of CPU.
SAMPLES = (
    Sample("several_beads", cross_check=False),
    Sample("concealed/recordings/r0003", cross_check=True),
    Sample("concealed/recordings/r0000", cross_check=True),
)


@dataclass(frozen=True)
class BeadScore:
    """One bead's forces beside the true ones.

    `true_pN` has one force per plateau (empty where no tether holds the bead), `relative_errors`
    one per plateau that gave a force to use, and `inside` counts the true forces within the stated
    68 % intervals.
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
    package = Path(__file__).parents[1]
    for folder in (package / "sample_data", package.parent / "sample_data"):
        if any(folder.glob("*/setup.toml")):
            return folder
    raise MtpipeError(
        "the bundled recordings are missing", mend="Install mtpipe again from its wheel."
    )


def recording_in(folder: Path) -> Path:
    """What `mtpipe run` is called with for a bundled recording: its file, or its setup."""
    return next(iter(sorted(folder.glob("recording.*"))), folder / "setup.toml")


def run_demo(out: Path, *, workers: int = 1, progress: NamedProgress | None = None) -> str:
    """Run bundled recordings and compare what mtpipe says with what made them.

    Returns
    -------
    Text: a table of true and measured forces, what was concealed and what was found, and where the
    reports are.
    """
    lines, found, reports = [_HEADINGS], [], []
    inside = forces = 0
    for number, sample in enumerate(SAMPLES):
        folder = sample_data() / sample.folder
        result = run(
            recording_in(folder),
            out / folder.name,
            workers=workers,
            cross_check=sample.cross_check,
            progress=_labelled(progress, f"{folder.name} ({number + 1}/{len(SAMPLES)})"),
        )
        truth = truth_of(folder)
        for score in scores(result, truth):
            lines.append(_line(folder.name, score))
            inside += score.inside
            forces += len(score.relative_errors)
        if sample.cross_check:
            found += [f"  {folder.name}: {said}" for said in findings(result, truth)]
        reports.append(f"  {out / folder.name / 'report' / 'index.html'}")
    share = f"{inside} of {forces} true forces lie within the 68 % intervals of the measured ones."
    concealed = ["", "What the setup does not say, and what the cross-check found:", *found, ""]
    return "\n".join([*lines, "", share, *(concealed if found else []), "Reports:", *reports])


def truth_of(folder: Path) -> dict[str, Any]:
    """What truth.json says of every tethered bead, or the answer to what a recording conceals.

    Of the latter also `concealed`, the names of the effects.
    """
    file = folder / "truth.json"
    if file.is_file():
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return found
    file = folder.parents[1] / "answers" / f"{folder.name}.json"
    answer = json.loads(file.read_text(encoding="utf-8"))
    names = [effect["effect"] for effect in answer["effects"]]
    return {
        "b1": {
            "what": f"one tether; concealed: {' and '.join(names) or 'nothing'}",
            "force_pN": [plateau["force_pN"] for plateau in answer["plateaus"]],
            "concealed": names,
        }
    }


def findings(result: Run, truth: Mapping[str, Any]) -> Iterator[str]:
    """Of every bead that was diagnosed: what was concealed, what was found, what it did."""
    for bead, found in result.mismatch["beads"].items():
        concealed = " and ".join(truth[bead]["concealed"]) or "nothing"
        if found["verdict"] == "consistent":
            yield f"{concealed} was concealed; recording and simulation agree."
            continue
        named = [f"{one['effect']}. {one['sentence']}" for one in found["effects"]]
        yield f"{concealed} was concealed; found: {' '.join(named) or 'no cause.'}"
        before, after = (
            statistics.median(
                abs(row[column] / true - 1)
                for row, true in zip(found["forces"], truth[bead]["force_pN"], strict=True)
            )
            for column in ("force_before_pN", "force_pN")
        )
        if named:
            yield (
                f"with the setup as it is, forces are off by {before:.1%} (median); with what was "
                f"found, by {after:.1%}."
            )


def scores(result: Run, truth: dict[str, Any]) -> Iterator[BeadScore]:
    """Compare the quoted forces of every calibrated bead with the content of truth.json."""
    verdicts = {verdict.bead: verdict.verdict for verdict in result.verdicts}
    for bead in result.calibration.beads:
        true = tuple(truth[bead.bead].get("force_pN", ()))
        errors, inside = _errors(result.forces[bead.bead], true) if true else ([], 0)
        what = truth[bead.bead]["what"]
        yield BeadScore(bead.bead, what, verdicts[bead.bead], true, tuple(errors), inside)


def _errors(forces: BeadForces, true_pN: tuple[float, ...]) -> tuple[list[float], int]:
    errors, inside = [], 0
    for number, true in enumerate(true_pN):
        force = forces.recommended[number].force
        if force.status != "ok":
            continue
        errors.append(force.value / true - 1)
        inside += force.interval[0] <= true <= force.interval[1]
    return errors, inside


_HEADINGS = (
    f"{'recording':20s}{'bead':6s}{'verdict':11s}{'true force (pN)':17s}{'median error':14s}"
    f"{'in interval':13s}what it is"
)


def _line(recording: str, score: BeadScore) -> str:
    force = error = within = "-"
    if score.true_pN:
        force = f"{min(score.true_pN):.2f} to {max(score.true_pN):.2f}"
    if score.relative_errors:
        sizes = [abs(error) for error in score.relative_errors]
        error = f"{statistics.median(sizes):.1%}"
        within = f"{score.inside} of {len(sizes)}"
    return (
        f"{recording:20s}{score.bead:6s}{score.verdict:11s}{force:17s}{error:14s}{within:13s}"
        f"{score.what}"
    )


def _labelled(progress: NamedProgress | None, label: str) -> NamedProgress | None:
    if progress is None:
        return None
    return lambda step, done, total: progress(f"{label}: {step}", done, total)
