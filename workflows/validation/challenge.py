"""The clean cases of the challenge set, if it lies beside the checkout.

They come from a brute-force simulator that shares no code and no closed form with mtpipe.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import recordings

import mtpipe

CHAIN = "marko-siggia"  # the formula of that simulator's potential


def clean_cases(challenge: Path) -> list[dict[str, Any]]:
    """Answers of the clean cases; none where the set is absent."""
    answers = challenge / "answers.json"
    if not answers.exists():
        return []
    cases = json.loads(answers.read_text(encoding="utf-8"))["cases"]
    return [case for case in cases if case["kind"] == "clean"]


def measure(job: tuple[Path, dict[str, Any]]) -> tuple[list[dict[str, object]], dict[str, object]]:
    """Force rows of one case, and a row about its tether and verdict."""
    challenge, case = job
    answer = recordings.analyse(
        mtpipe.load(challenge / "cases" / case["name"] / "recording.csv.gz")
    )
    rows = recordings.force_rows(answer, [p["force_pN"] for p in case["plateaus"]])
    for row in rows:
        row["case"] = case["name"]
    chains = {} if answer.curve is None else {fit.model: fit for fit in answer.curve.fits}
    own = chains.get(CHAIN)
    fit = None if answer.curve is None else answer.curve.recommended
    return rows, {
        "case": case["name"],
        "contour_true": case["world"]["contour_nm"],
        "persistence_true": case["world"]["persistence_nm"],
        "contour": None if fit is None else fit.contour_length_nm,
        "persistence": None if fit is None else fit.persistence_length_nm,
        "own_chain_persistence": None if own is None else own.persistence_length_nm,
        "chain": "none" if fit is None else fit.model,
        "verdict": answer.verdict.verdict,
        "reasons": "; ".join(answer.verdict.reasons),
    }
