"""Every method side by side on the same exact simulated traces: the tables of docs/methods.md.

    python workflows/validation/methods.py --repeats 200 --seed 1 --write docs/methods.md

mtpipe's maximum likelihood and posterior, its other methods by name, and tweezepy in an environment
of its own (`peers`), on the traces of docs/validation.md that have no gaps and are not short.
Prints the tables, and writes them into the page if asked. The same seed and number of repeats give
the same numbers, but for the seconds.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import method_tables
import numpy as np
import pandas as pd
import peers

sys.path.append(str(Path(__file__).parents[1] / "common"))
import pages
import traces
from method_tables import LIKELIHOOD, POSTERIOR
from traces import Case

import mtpipe
from mtpipe.methods import METHODS, fit_by_method

MCMC_CASE = Case("free", 0.4)
MCMC_REPEATS = 3  # tweezepy's sampler takes a third of a minute a trace: its time, no statistics
NOTHING = (math.nan, math.nan, math.nan)
Run = Callable[[Callable[[Any], Any], Iterable[Any]], list[Any]]


def main() -> None:
    """Run the whole study."""
    parser = argparse.ArgumentParser(description="Every method on the same simulated traces.")
    parser.add_argument("--repeats", type=int, default=200, help="traces per case, at least 2")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--write", type=Path, help="page to put the tables into")
    parser.add_argument(
        "--tweezepy-env",
        type=Path,
        default=Path(tempfile.gettempdir()) / "mtpipe-study-tweezepy",
        help="folder of tweezepy's virtual environment, made if need be (default: %(default)s)",
    )
    choice = parser.parse_args()
    # the processes share the cores among themselves; numerical libraries are not to do so as well
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    python = peers.environment(choice.tweezepy_env)
    cases = [case for case in traces.cases() if case.part in ("free", "noisy")]
    began = time.perf_counter()
    with get_context("spawn").Pool(choice.workers) as pool:

        def run(what: Callable[[Any], Any], jobs: Iterable[Any]) -> list[Any]:
            return pool.map(what, list(jobs), chunksize=1)

        rows = own_rows(run, cases, choice.seed, choice.repeats)
        rows += peer_rows(run, python, cases, choice.seed, choice.repeats)
    seconds = time.perf_counter() - began
    blocks = method_tables.blocks(cases, pd.DataFrame(rows))
    command = f"python workflows/validation/methods.py --repeats {choice.repeats}"
    blocks["run"] = (
        f"Printed {datetime.now(UTC):%Y-%m-%d} by mtpipe {mtpipe.__version__} with\n\n"
        f"    {command} --seed {choice.seed} --write docs/methods.md\n\n"
        f"in {seconds:.0f} s with {choice.workers} processes; {choice.repeats} traces a point."
    )
    for name, block in blocks.items():
        print(f"\n{name}\n{'-' * len(name)}\n{block}")
    if choice.write is not None:
        page = choice.write.read_text(encoding="utf-8")
        choice.write.write_text(pages.into_page(page, blocks), encoding="utf-8")


def own_rows(run: Run, cases: Sequence[Case], seed: int, repeats: int) -> list[dict[str, object]]:
    """Rows of mtpipe's methods: one per case, trace and method."""
    jobs = ((case, seed, repeat) for case, repeat in itertools.product(cases, range(repeats)))
    return list(itertools.chain.from_iterable(run(measure, jobs)))


def peer_rows(
    run: Run, python: Path, cases: Sequence[Case], seed: int, repeats: int
) -> list[dict[str, object]]:
    """Rows of tweezepy, run by the Python interpreter of its environment."""
    jobs = [peers.Job(python, case, seed, repeats, case.part) for case in cases]
    jobs.append(peers.Job(python, MCMC_CASE, seed, min(repeats, MCMC_REPEATS), "mcmc"))
    rows = []
    for job, (names, estimates, cpu_s) in zip(jobs, run(peers.fit, jobs), strict=True):
        bound = _bound(job.case, seed)
        rows += [
            _row(job.case, bound, name, *estimates[repeat, i], cpu_s[repeat, i])
            for repeat, (i, name) in itertools.product(range(job.repeats), enumerate(names))
        ]
    return rows


def measure(job: tuple[Case, int, int]) -> list[dict[str, object]]:
    """Rows of mtpipe's methods for one trace from (case, seed, repeat)."""
    case, seed, _ = job
    bound = _bound(case, seed)
    return [_row(case, bound, name, *estimates, cpu_s) for name, estimates, cpu_s in _fits(job)]


def _fits(
    job: tuple[Case, int, int],
) -> Iterator[tuple[str, list[tuple[float, float, float]], float]]:
    """Name, (value, low, high) of stiffness and friction, and CPU seconds of each method."""
    x, known, random = traces.draw(*job)
    options = _options(job[0], known)
    ways: dict[str, Callable[[], Any]] = {
        LIKELIHOOD: lambda: mtpipe.fit_trace(x, **options),
        POSTERIOR: lambda: mtpipe.sample_posterior(mtpipe.fit_trace(x, **options), seed=random),
    }
    for name in METHODS:
        ways[name] = lambda name=name: fit_by_method(name, x, **options)
    for name, way in ways.items():
        began = time.process_time()
        try:
            answer = way()
            told = [
                (one.value, *one.interval) if one.status != "fixed" else NOTHING
                for one in (answer.stiffness, answer.friction)
            ]
        except mtpipe.FitError:
            told = [NOTHING, NOTHING]
        yield name, told, time.process_time() - began


def _options(case: Case, known: tuple[float, float] | None) -> dict[str, Any]:
    return {
        "frame_rate_hz": traces.RATE_HZ,
        "exposure_s": case.exposure / traces.RATE_HZ,
        "temperature_K": traces.TEMPERATURE_K,
        "tracking_noise_nm": "fit" if case.noise_nm else 0.0,
        "friction": known,
    }


@functools.cache
def _bound(case: Case, seed: int) -> np.ndarray:
    """Cramér–Rao bound of a case, from the spectrum's bins of its first trace."""
    x, known, _ = traces.draw(case, seed, 0)
    return traces.error_bound(case, mtpipe.fit_trace(x, **_options(case, known)).model)


def _row(
    case: Case,
    bound: np.ndarray,
    method: str,
    stiffness: Sequence[float],
    friction: Sequence[float],
    cpu_s: float,
) -> dict[str, object]:
    """A row for a pandas table; nan where there is no positive result, or no interval."""
    row: dict[str, object] = {"case": case.name, "method": method, "cpu_s": cpu_s}
    for i, (name, (value, low, high)) in enumerate((("k", stiffness), ("friction", friction))):
        told = math.isfinite(value) and value > 0
        stated = told and math.isfinite(low) and math.isfinite(high)
        row[f"{name}_error"] = math.log(value) - case.truth[i] if told else math.nan
        row[f"{name}_holds"] = (
            float(traces.holds((low, high), case.truth[i])) if stated else math.nan
        )
        row[f"{name}_bound"] = bound[i]
    return row


if __name__ == "__main__":
    main()
