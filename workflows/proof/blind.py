"""One recording of the proof: made, sealed, and diagnosed from its file and nothing else."""

from __future__ import annotations

import json
import shutil
import time
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import generate

import mtpipe
from mtpipe.ground.files import write_atomically

BEAD = "b1"
# What is recorded of a named effect.
OF_AN_EFFECT = (
    "effect", "parameters", "delta_bic", "heldout_gain_nats", "p_before", "p_after", "equivalent",
    "probability",
)  # fmt: skip
# Significant digits of what is recorded of a diagnosis.
DIGITS = 6


@dataclass(frozen=True)
class Job:
    """A recording of a set, and the folder of results."""

    seed: int
    number: int
    form: generate.Form
    results: Path


def outcome_file(results: Path, number: int) -> Path:
    """Where the outcome of a recording is."""
    return results / "outcomes" / f"r{number:04d}.json"


def seal_file(results: Path, name: str) -> Path:
    """Where the hash of a recording's answer is, from before it is diagnosed."""
    return results / "sealed" / f"{name}.sha256"


def run(job: Job) -> str:
    """Make, seal and diagnose a recording, and write the outcome.

    The recording is removed when it is diagnosed; seed and number make it again.
    """
    warnings.simplefilter("ignore")
    case = generate.make(job.seed, job.number, job.form)
    recordings = job.results / "recordings"
    digest = generate.write(case, recordings, job.results / "answers")
    name = case.name
    out, seal = outcome_file(job.results, job.number), seal_file(job.results, name)
    for path in (out, seal):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(seal, digest + "\n")
    outcome = {"name": name, **diagnosed(recordings / name)}
    write_atomically(out, json.dumps(outcome, ensure_ascii=False) + "\n")
    shutil.rmtree(recordings / name)
    return f"{name} in {outcome['seconds']:.0f} s"


def diagnosed(folder: Path) -> dict[str, Any]:
    """What the diagnosis says of a recording, in the form that is recorded.

    Parameters
    ----------
    folder : of recording.csv.gz and setup.toml. Nothing else is given to the diagnosis.

    Returns
    -------
    `bead`: what is needed of the bead in `mismatch.json`, or None; `failure`: why there is none;
    `seconds`: of CPU time.
    """
    began = time.process_time()
    bead, failure = None, None
    try:
        recording = mtpipe.subtract_drift(mtpipe.load(folder / "recording.csv.gz"))
        mismatch = mtpipe.diagnose(recording, seed=1)
        found = mismatch.as_dict()["beads"].get(BEAD)
        bead = None if found is None else compact(found)
        failure = None if bead else str(mismatch.refused.get(BEAD, "no answer"))
    except Exception:  # whatever goes wrong is an outcome too
        failure = traceback.format_exc(limit=-3)
    return {"bead": bead, "failure": failure, "seconds": round(time.process_time() - began, 1)}


def compact(bead: dict[str, Any]) -> dict[str, Any]:
    """What scoring and tables need of one bead in `mismatch.json`."""
    kept: dict[str, Any] = {
        "verdict": bead["verdict"],
        "located": bead["located"][:3],
        "effects": [{key: one[key] for key in OF_AN_EFFECT} for one in bead["effects"]],
        "force_bound_percent": bead["force_bound_percent"],
        "forces": bead["forces"],
    }
    rounded: dict[str, Any] = _rounded(kept)
    return rounded


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(one) for one in value]
    return value
