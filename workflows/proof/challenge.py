"""The diagnosis on recordings from an independent simulator: the table of docs/diagnosis.md.

    python workflows/proof/challenge.py --runs runs/challenge --workers 2 --write docs/diagnosis.md

Reads ../shared/challenge beside the checkout (its README says what is known of it), writes one
`mismatch.json` per case below the folder of runs, in the form its own grader reads, and prints what
was named beside what was concealed. Cases that the folder already has are not run again. Cases
without a published answer are run too, and only their answer is printed.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import warnings
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import mtpipe

CHALLENGE = Path(__file__).parents[2].parent / "shared" / "challenge"
MARK = "<!-- challenge -->"


def main() -> None:
    """Run what is missing, then print."""
    parser = argparse.ArgumentParser(description="Diagnose the challenge's recordings.")
    parser.add_argument("--challenge", type=Path, default=CHALLENGE)
    parser.add_argument("--runs", type=Path, required=True, help="folder of results")
    parser.add_argument("--workers", type=int, default=2, help="processes; 0: only print")
    parser.add_argument("--write", type=Path, help="page to put the table into")
    choice = parser.parse_args()
    if not choice.challenge.is_dir():
        parser.exit(1, f"{choice.challenge} is not there: the challenge is no part of mtpipe.\n")
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    names = sorted(path.name for path in (choice.challenge / "cases").iterdir())
    missing = [name for name in names if not (choice.runs / name / "mismatch.json").exists()]
    jobs = [(choice.challenge / "cases" / name, choice.runs / name) for name in missing]
    if choice.workers > 0:
        with get_context("spawn").Pool(choice.workers) as pool:
            for name in pool.imap_unordered(diagnosed, jobs):
                print("done", name, flush=True)
    text = table(choice.challenge, choice.runs, names)
    print(text)
    if choice.write is not None:
        before, _, after = choice.write.read_text(encoding="utf-8").split(MARK)
        page = f"{before}{MARK}\n{text}\n{MARK}{after}"
        choice.write.write_text(page, encoding="utf-8")


def diagnosed(job: tuple[Path, Path]) -> str:
    """Diagnose one case and write its answer."""
    warnings.simplefilter("ignore")
    case, out = job
    began = time.process_time()
    recording = mtpipe.subtract_drift(mtpipe.load(case / "recording.csv.gz"))
    answer = mtpipe.diagnose(recording, seed=1).as_dict()
    out.mkdir(parents=True, exist_ok=True)
    (out / "mismatch.json").write_text(json.dumps(answer, indent=1), encoding="utf-8")
    return f"{case.name} in {time.process_time() - began:.0f} s"


def table(challenge: Path, runs: Path, names: list[str]) -> str:
    """Markdown: a row per case, those with answers first, and a summary."""
    answers = {
        one["name"]: one
        for one in json.loads((challenge / "answers.json").read_text(encoding="utf-8"))["cases"]
    }
    rows = [
        "| case | concealed | strength | verdict | named | p before → after | largest force error "
        "before, after (%) |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    right = clean = quiet = 0
    forces: list[tuple[float, float, float]] = []
    for name in sorted(names, key=lambda one: (one not in answers, one)):
        path = runs / name / "mismatch.json"
        if not path.exists():
            rows.append(f"| {name} | | | not run | | | |")
            continue
        found = json.loads(path.read_text(encoding="utf-8"))["beads"]
        bead = found.get("b1")
        if bead is None:
            rows.append(f"| {name} | | | could not be simulated | | | |")
            continue
        named = [one["effect"] for one in bead["effects"]]
        truth = answers.get(name)
        concealed = [one["effect"] for one in truth["effects"]] if truth else []
        if truth and truth["kind"] == "clean":
            clean += 1
            quiet += bead["verdict"] == "consistent"
        elif truth:
            right += bead["verdict"] == "explained" and sorted(named) == sorted(concealed)
        forces += _forces(bead, truth)
        rows.append(
            f"| {name} | {', '.join(concealed) or ('nothing' if truth else 'sealed')} | "
            f"{(truth or {}).get('strength') or ''} | {bead['verdict']} | {_named(bead)} | "
            f"{_p_values(bead)} | {_errors(bead, truth)} |"
        )
    others = len(answers) - clean
    printed = f"Printed {datetime.now(UTC):%Y-%m-%d} by mtpipe {mtpipe.__version__} with"
    command = "python workflows/proof/challenge.py --runs DIR --write docs/diagnosis.md"
    summary = (
        f"{right} of {others} concealed cases explained with exactly the right names; "
        f"{quiet} of {clean} clean ones consistent. {_told(forces)}"
    )
    return "\n".join([f"{printed} `{command}`.", "", summary, "", *rows])


def _named(bead: dict[str, Any]) -> str:
    parts = []
    for one in bead["effects"]:
        strengths = ", ".join(
            f"{key} {value['value']:.3g} ± {value['stderr']:.1g}"
            for key, value in one["parameters"].items()
        )
        alike = f" or {', '.join(one['equivalent'])}" if one["equivalent"] else ""
        parts.append(f"{one['effect']}{alike}" + (f" ({strengths})" if strengths else ""))
    return "; ".join(parts)


def _p_values(bead: dict[str, Any]) -> str:
    if not bead["effects"]:
        return ""
    # effects stand in another order than they were found in
    before = min(effect["p_before"] for effect in bead["effects"])
    after = max(effect["p_after"] for effect in bead["effects"])
    return f"{before:.0e} → {after:.2g}"


def _forces(bead: dict[str, Any], truth: dict[str, Any] | None) -> list[tuple[float, float, float]]:
    """Per plateau relative errors before and after, and the latter in standard errors."""
    plateaus = truth["plateaus"] if truth else []
    return [
        (
            row["force_before_pN"] / true["force_pN"] - 1,
            row["force_pN"] / true["force_pN"] - 1,
            (row["force_pN"] - true["force_pN"]) / row["stderr_pN"],
        )
        for row, true in zip(bead["forces"] if plateaus else [], plateaus, strict=True)
    ]


def _told(forces: list[tuple[float, float, float]]) -> str:
    before, after, pulls = np.abs(np.array(forces).reshape(-1, 3)).T
    return (
        f"Of their {len(pulls)} forces {np.mean(pulls <= 1):.0%} are within one standard error and "
        f"{np.mean(pulls <= 2):.0%} within two; in the median they are {np.median(after):.1%} off, "
        f"{np.median(before):.1%} before."
    )


def _errors(bead: dict[str, Any], truth: dict[str, Any] | None) -> str:
    """The largest relative error before and after, in percent."""
    each = np.array(_forces(bead, truth)).reshape(-1, 3)[:, :2].T
    return ", ".join(f"{100 * one[np.argmax(np.abs(one))]:+.1f}" for one in each if one.size)


if __name__ == "__main__":
    main()
