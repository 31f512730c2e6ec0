"""How true mtpipe's numbers are, on data whose truth is known: the tables of docs/validation.md.

    python workflows/validation/study.py --write docs/validation.md

Prints the tables, and writes them into the page if asked. The same seed and number of repeats give
the same numbers, but for the seconds.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import challenge
import no_reference
import pandas as pd
import recordings
import report

sys.path.append(str(Path(__file__).parents[1] / "common"))
import pages
import series
import series_cases
import series_tables
import traces

import mtpipe

CHECKOUT = Path(__file__).resolve().parents[2]
Run = Callable[[Callable[[Any], Any], Iterable[Any]], list[Any]]


def main() -> None:
    """Run the parts of the study that are asked for."""
    parser = argparse.ArgumentParser(description="mtpipe on data whose truth is known.")
    parser.add_argument(
        "--repeats", type=int, default=200, help="traces per case, and number of recordings"
    )
    parser.add_argument("--only", choices=tuple(PARTS), nargs="+", default=tuple(PARTS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--write", type=Path, help="page to put the tables into")
    parser.add_argument("--challenge", type=Path, default=CHECKOUT.parent / "shared" / "challenge")
    choice = parser.parse_args()
    # the processes share the cores among themselves; numerical libraries are not to do so as well
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    for part in choice.only:
        began = time.perf_counter()
        with get_context("spawn").Pool(choice.workers) as pool:
            study = Study(
                lambda what, jobs, pool=pool: pool.map(what, list(jobs), chunksize=1),
                choice.repeats,
                choice.seed,
                choice.challenge,
            )
            blocks = PARTS[part](study)
        command = (
            f"python workflows/validation/study.py --only {part} --repeats {choice.repeats} "
            f"--seed {choice.seed}"
        )
        printed = (
            f"Printed {datetime.now(UTC):%Y-%m-%d} by mtpipe {mtpipe.__version__}: `{command}` "
            f"({time.perf_counter() - began:.0f} s with {choice.workers} processes)."
        )
        for name, block in blocks.items():
            blocks[name] = f"{block}\n\n{printed}"
            print(f"\n{name}\n{'-' * len(name)}\n{blocks[name]}", flush=True)
        if choice.write is not None:
            page = choice.write.read_text(encoding="utf-8")
            choice.write.write_text(pages.into_page(page, blocks), encoding="utf-8")


@dataclass(frozen=True)
class Study:
    """What every part is given: `run` maps a function over jobs on all processes."""

    run: Run
    repeats: int
    seed: int
    challenge_set: Path

    def trace_rows(self, cases: Sequence[traces.Case]) -> pd.DataFrame:
        """Rows of single traces, `repeats` of each case."""
        jobs = ((c, self.seed, i) for c, i in itertools.product(cases, range(self.repeats)))
        return pd.DataFrame(self.run(traces.measure, jobs))


def _traces(name: str, table: Callable[..., str]) -> Callable[[Study], dict[str, str]]:
    """The part that makes one table of single traces."""

    def blocks(study: Study) -> dict[str, str]:
        cases = [case for case in traces.cases() if case.part == name]
        return {name: table(cases, study.trace_rows(cases))}

    return blocks


def _recordings(study: Study) -> dict[str, str]:
    outcomes = study.run(recordings.measure, ((study.seed, i) for i in range(study.repeats)))
    return {
        "recordings": report.recording_forces_table(outcomes),
        "flags": report.flags_table(outcomes, len(recordings.FORCES_PN)),
        "verdicts": report.verdicts_table(outcomes),
        "lengths": report.lengths_table(outcomes),
    }


def _no_reference(study: Study) -> dict[str, str]:
    outcomes = study.run(no_reference.measure, ((study.seed, i) for i in range(study.repeats)))
    return {"no reference": no_reference.coverage_table(outcomes)}


def _challenge(study: Study) -> dict[str, str]:
    clean = challenge.clean_cases(study.challenge_set)
    answers = study.run(challenge.measure, ((study.challenge_set, case) for case in clean))
    return {"challenge": report.challenge_table(answers)}


def _series(study: Study) -> dict[str, str]:
    """Name → Markdown of the tables of joint fits."""
    repeats = study.repeats

    def rows(
        measure: Callable[[Any], Any], cases: Iterable[series_cases.Case], number: int = repeats
    ) -> pd.DataFrame:
        jobs = ((case, study.seed, i) for case, i in itertools.product(cases, range(number)))
        return pd.DataFrame(itertools.chain.from_iterable(study.run(measure, jobs)))

    true, faulty = series_cases.TRUE, series_cases.FAULTY
    joint = rows(series.measure_joint, true)
    pipeline = rows(series.measure_pipeline, [series_cases.HELD])
    # there are many kinds of faults, and half of the repeats tell enough of each
    chosen = [rows(series.measure_choice, true), rows(series.measure_choice, faulty, repeats // 2)]
    return {
        "series": series_tables.joint_table(true, joint),
        "series pipeline": series_tables.pipeline_table(pipeline, joint),
        "series choice": series_tables.choice_table((*true, *faulty), pd.concat(chosen)),
    }


PARTS: dict[str, Callable[[Study], dict[str, str]]] = {
    "free": _traces("free", report.free_table),
    "noisy": _traces("noisy", report.noisy_table),
    "gaps": _traces("gaps", report.gaps_table),
    "short": _traces("short", report.short_table),
    "series": _series,
    "recordings": _recordings,
    "no_reference": _no_reference,
    "challenge": _challenge,
}


if __name__ == "__main__":
    main()
