"""How true mtpipe's numbers are, on data whose truth is known: the tables of docs/validation.md.

    python workflows/validation/study.py --write docs/validation.md

Prints the tables, and writes them into the page if asked. The same seed and number of repeats give
the same numbers, but for the seconds.
"""

from __future__ import annotations

import argparse
import itertools
import os
import time
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import challenge
import pandas as pd
import recordings
import report
import series
import series_cases
import series_tables
import traces

import mtpipe

CHECKOUT = Path(__file__).resolve().parents[2]
Run = Callable[[Callable[[Any], Any], Iterable[Any]], list[Any]]


def main() -> None:
    """Run the whole study."""
    parser = argparse.ArgumentParser(description="mtpipe on data whose truth is known.")
    parser.add_argument(
        "--repeats", type=int, default=200, help="traces per case, and number of recordings"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--write", type=Path, help="page to put the tables into")
    parser.add_argument("--challenge", type=Path, default=CHECKOUT.parent / "shared" / "challenge")
    choice = parser.parse_args()
    # the processes share the cores among themselves; numerical libraries are not to do so as well
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    began = time.perf_counter()
    with get_context("spawn").Pool(choice.workers) as pool:
        blocks = _blocks(
            lambda what, jobs: pool.map(what, list(jobs), chunksize=1),
            choice.repeats,
            choice.seed,
            choice.challenge,
        )
    seconds = time.perf_counter() - began
    command = f"python workflows/validation/study.py --repeats {choice.repeats}"
    blocks["run"] = (
        f"Printed {datetime.now(UTC):%Y-%m-%d} by mtpipe {mtpipe.__version__} with\n\n"
        f"    {command} --seed {choice.seed} --write docs/validation.md\n\n"
        f"in {seconds:.0f} s with {choice.workers} processes."
    )
    for name, block in blocks.items():
        print(f"\n{name}\n{'-' * len(name)}\n{block}")
    if choice.write is not None:
        page = choice.write.read_text(encoding="utf-8")
        choice.write.write_text(report.into_page(page, blocks), encoding="utf-8")


def _blocks(run: Run, repeats: int, seed: int, challenge_set: Path) -> dict[str, str]:
    """Name → Markdown of every table."""
    cases = traces.cases()
    rows = pd.DataFrame(
        run(traces.measure, ((c, seed, i) for c, i in itertools.product(cases, range(repeats))))
    )
    outcomes = run(recordings.measure, ((seed, i) for i in range(repeats)))
    clean = challenge.clean_cases(challenge_set)
    answers = run(challenge.measure, ((challenge_set, case) for case in clean))
    return _series_blocks(run, repeats, seed) | {
        "free": report.free_table(cases, rows),
        "noisy": report.noisy_table(cases, rows),
        "gaps": report.gaps_table(cases, rows),
        "short": report.short_table(cases, rows),
        "recordings": report.recording_forces_table(outcomes),
        "flags": report.flags_table(outcomes, len(recordings.FORCES_PN)),
        "verdicts": report.verdicts_table(outcomes),
        "lengths": report.lengths_table(outcomes),
        "challenge": report.challenge_table(answers),
    }


def _series_blocks(run: Run, repeats: int, seed: int) -> dict[str, str]:
    """Name → Markdown of the tables of joint fits."""

    def rows(
        measure: Callable[[Any], Any], cases: Iterable[series_cases.Case], number: int = repeats
    ) -> pd.DataFrame:
        jobs = ((case, seed, i) for case, i in itertools.product(cases, range(number)))
        return pd.DataFrame(itertools.chain.from_iterable(run(measure, jobs)))

    true, faulty = series_cases.TRUE, series_cases.FAULTY
    joint = rows(series.measure_joint, true)
    pipeline = rows(series.measure_pipeline, [series_cases.HELD])
    # there are many kinds of faults, and half of the repeats tell enough of each
    chosen = [rows(series.measure_choice, true), rows(series.measure_choice, faulty, repeats // 2)]
    return {
        "series": series_tables.joint_table(true, joint),
        "series pipeline": series_tables.pipeline_table(pipeline, joint),
        "series false alarms": series_tables.false_alarm_table(true, joint),
        "series choice": series_tables.choice_table((*true, *faulty), pd.concat(chosen)),
    }


if __name__ == "__main__":
    main()
