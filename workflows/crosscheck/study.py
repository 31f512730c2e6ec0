"""Is the cross-check honest, and what does it notice? The tables of docs/crosscheck.md.

    python workflows/crosscheck/study.py --results FOLDER --write docs/crosscheck.md

Cross-checks clean simulated recordings of varied configurations, and recordings with effects put in
by hand. Every recording's outcome is added to a file of the results folder as soon as it is there;
what is there already is not done again, so that the study can be run in pieces.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parents[1] / "common"))
import clean
import effects
import numpy as np
import pages
import pandas as pd
from scipy import stats

import mtpipe
from mtpipe.diagnosis.explanation import ALARM_P

# The first is the diagnosis's own.
LEVELS = (ALARM_P, 0.01, 0.05, 0.1)
NOTICED_BELOW = 0.01
SPLITS = ("engine", "formula", "radius_nm", "contour_nm", "noise listed", "frames")
Job = tuple[Any, ...]


def main() -> None:
    """Run what is missing of the study, and print its tables."""
    parser = argparse.ArgumentParser(description="The cross-check on recordings of known truth.")
    parser.add_argument("--results", type=Path, required=True, help="folder of the outcomes")
    parser.add_argument("--clean", type=int, default=500, help="clean recordings")
    parser.add_argument(
        "--repeats", type=int, default=20, help="recordings per effect and strength"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--write", type=Path, help="page to put the tables into")
    parser.add_argument("--looks", action="store_true", help="print the mean score of every look")
    choice = parser.parse_args()
    # the processes share the cores among themselves; numerical libraries are not to do so as well
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    choice.results.mkdir(parents=True, exist_ok=True)
    numbers = range(choice.clean)
    strengths = [(e.name, strength) for e in effects.EFFECTS for strength in e.strengths]
    with get_context("spawn").Pool(choice.workers) as pool:
        calm = _outcomes(
            choice.results / "clean.jsonl",
            ("seed", "number"),
            [(choice.seed, number) for number in numbers],
            lambda jobs: pool.imap_unordered(clean.measure, jobs),
        )
        noticed = _outcomes(
            choice.results / "effects.jsonl",
            ("effect", "strength", "seed", "number"),
            [
                (*one, choice.seed, n)
                for n, one in itertools.product(range(choice.repeats), strengths)
            ],
            lambda jobs: pool.imap_unordered(effects.measure, jobs),
        )
    blocks = {}
    if calm:
        blocks["clean"] = clean_tables(calm)
    if noticed:
        blocks["power"] = power_table(noticed)
    command = (
        f"python workflows/crosscheck/study.py --results DIR --clean {choice.clean} "
        f"--repeats {choice.repeats} --seed {choice.seed}"
    )
    printed = f"Printed {datetime.now(UTC):%Y-%m-%d} by mtpipe {mtpipe.__version__}: `{command}`."
    for name, block in blocks.items():
        blocks[name] = f"{block}\n\n{printed}"
        print(f"\n{name}\n{'-' * len(name)}\n{blocks[name]}", flush=True)
    if choice.looks:
        for formula in sorted({row["formula"] for row in calm}):
            print(f"\n{formula}\n{looks_table([r for r in calm if r['formula'] == formula])}")
    if choice.write is not None:
        page = choice.write.read_text(encoding="utf-8")
        choice.write.write_text(pages.into_page(page, blocks), encoding="utf-8")


def _outcomes(
    path: Path,
    key: Sequence[str],
    jobs: Sequence[Job],
    run: Callable[[Iterable[Job]], Iterable[dict[str, Any]]],
) -> list[dict[str, Any]]:
    """Outcomes of all jobs, of which those in the file are not run again."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    found = {tuple(row[k] for k in key): row for row in map(json.loads, lines)}
    missing = [job for job in jobs if job not in found]
    with path.open("a", encoding="utf-8") as file:
        for row in run(missing):
            file.write(json.dumps(row) + "\n")
            file.flush()
            found[tuple(row[k] for k in key)] = row
    return [found[job] for job in jobs]


def clean_tables(rows: Sequence[dict[str, Any]]) -> str:
    """False alarms of all clean recordings, and of parts of them."""
    table = pd.DataFrame([{k: v for k, v in row.items() if k != "scores"} for row in rows])
    table["noise listed"] = ["tracking_noise" in listed for listed in table["listed"]]
    table["frames"] = np.where(table["frames"] < table["frames"].median(), "fewer", "more")
    lines = [
        "| recordings | number | KS p | " + " | ".join(f"p < {x:g} (%)" for x in LEVELS) + " |",
        "| --- | --- | --- |" + " --- |" * len(LEVELS),
        _alarms("all", table["p_value"].to_numpy()),
    ]
    for split in SPLITS:
        lines += [
            _alarms(f"{split.replace('_nm', ' / nm')}: {value}", part["p_value"].to_numpy())
            for value, part in table.groupby(split)
        ]
    seconds, twins = table["seconds"], table["simulations"]
    return "\n".join(lines) + (
        f"\n\nSimulations per recording: {twins.mean():.0f} on average; {seconds.median():.1f} s "
        f"in the median, {seconds.max():.1f} s at most, with simulation and drift subtraction."
    )


def _alarms(name: str, p_values: np.ndarray[Any, Any]) -> str:
    shares = []
    for level in LEVELS:
        count = int(np.sum(p_values < level))
        low, high = stats.binomtest(count, len(p_values)).proportion_ci(0.95)
        shares.append(f"{100 * count / len(p_values):.1f} ({100 * low:.1f} – {100 * high:.1f})")
    ks = stats.kstest(p_values, "uniform").pvalue
    return f"| {name} | {len(p_values)} | {ks:.2g} | {' | '.join(shares)} |"


def power_table(rows: Sequence[dict[str, Any]]) -> str:
    """Share of recordings in which each effect is noticed, by strength."""
    table = pd.DataFrame(rows)
    repeats = len(table) // len(table.groupby(["effect", "strength"]))
    lines = [
        f"| effect | strength: noticed in % of {repeats} | in |",
        "| --- | --- | --- |",
    ]
    for effect in effects.EFFECTS:
        mine = table[table["effect"] == effect.name]
        shares = []
        for strength in effect.strengths:
            noticed = mine.loc[mine["strength"] == strength, "p_value"] < NOTICED_BELOW
            shown = f"**{100 * noticed.mean():.0f}**"
            shares.append(f"{strength:g}: {shown}" if effect.unit else shown)
        lines.append(f"| {effect.name} | {', '.join(shares)} | {effect.unit} |")
    return "\n".join(lines)


def looks_table(rows: Sequence[dict[str, Any]]) -> str:
    """Mean and spread of the scores of clean recordings, by statistic and axis: 0 and 1 if fair."""
    found: dict[tuple[str, str, bool], list[float]] = {}
    for row in rows:
        for statistic, axis, pooled, _, score in row["scores"]:
            found.setdefault((statistic, axis, pooled), []).append(score)
    lines = []
    for (statistic, axis, pooled), scores in sorted(found.items()):
        mean, spread = np.mean(scores), np.std(scores)
        error = spread / math.sqrt(len(scores))
        where = "all plateaus" if pooled else "one"
        lines.append(f"{statistic:24s}{axis:4s}{where:14s}{mean:+.2f} ± {error:.2f}{spread:8.2f}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
