"""The blind proof: concealed effects, sealed answers, and what the diagnosis makes of them.

    python workflows/proof/proof.py --results runs/proof --recordings 300 --seed 1 --workers 2 \
        --write docs/proof.md

Makes a set of recordings from a seed, one at a time, seals what each conceals, diagnoses it by its
file alone, and afterwards unseals and prints. What the folder of results already has is not done
again. Tables are those of whatever is there. With `--record FILE` answers and outcomes go into one
file, from which `--from FILE` prints without running anything, and `--resume FILE` goes on.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import blind
import sealing
import tables
from generate import Form
from scoring import score

import mtpipe

MARK = "<!-- proof -->"
# Options that say what a set's recordings have in common, and what they usually are.
FORM = {"frames": 4096, "plateaus": None, "formula": "marko-siggia"}
RECORDED = Path(__file__).with_name("results.jsonl")


def main() -> None:
    """Run what is missing, unseal, print."""
    choice = _choice()
    if choice.results is None:
        content = json.loads(choice.source.read_text(encoding="utf-8").splitlines()[0])
        about, rows = content["about"], read_rows(choice.source)
    else:
        # the processes share the cores; numerical libraries are not to do so as well
        os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        about = settled(choice)
        if choice.resume is not None:
            put_back(choice.resume, choice.results)
        numbers = range(choice.recordings) if choice.only is None else choice.only
        run_missing(choice, numbers)
        rows = unsealed_rows(choice.results, range(choice.recordings))
    text = page_part(about, rows)
    if choice.record is not None:
        write_rows(choice.record, about, rows)
    if choice.write is not None:
        before, _, after = choice.write.read_text(encoding="utf-8").split(MARK)
        choice.write.write_text(f"{before}{MARK}\n{text}\n{MARK}{after}", encoding="utf-8")
    print(text)


def _choice() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="The blind proof of the diagnosis.")
    parser.add_argument("--results", type=Path, help="folder of results; none: print --from")
    parser.add_argument("--recordings", type=int, default=300, help="size of the set")
    parser.add_argument("--seed", type=int, default=1, help="of the set")
    parser.add_argument("--frames", type=int, default=FORM["frames"], help="per plateau")
    parser.add_argument("--plateaus", type=int, help="per recording; none: drawn")
    parser.add_argument(
        "--formula", choices=("marko-siggia", "bouchiat", "drawn"), default=FORM["formula"]
    )
    parser.add_argument("--workers", type=int, default=1, help="processes; 0: only print")
    parser.add_argument("--only", type=_numbers, help="run only these recordings: N..M, M included")
    parser.add_argument("--limit-minutes", type=float, help="begin no recording after so long")
    parser.add_argument("--write", type=Path, help="page to put the tables into")
    parser.add_argument("--record", type=Path, help="file to put answers and outcomes into")
    parser.add_argument("--from", dest="source", type=Path, default=RECORDED, help="such a file")
    parser.add_argument("--resume", type=Path, help="such a file, whose outcomes are not run again")
    choice = parser.parse_args()
    if choice.results is None and not choice.source.exists():
        parser.error(f"{choice.source} is not there: give a folder of --results, or a file --from")
    return choice


def _numbers(text: str) -> range:
    first, _, last = text.partition("..")
    return range(int(first), int(last or first) + 1)


def settled(choice: argparse.Namespace) -> dict[str, Any]:
    """What the results in the folder are of; it holds those of one seed and form only."""
    about = {"seed": choice.seed, "frames": choice.frames, "formula": choice.formula}
    if choice.plateaus is not None:
        about["plateaus"] = choice.plateaus
    path = choice.results / "about.json"
    if path.exists() and json.loads(path.read_text(encoding="utf-8")) != about:
        raise SystemExit(f"{choice.results} holds results of another seed or form")
    choice.results.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(about), encoding="utf-8")
    made = {"date": f"{datetime.now(UTC):%Y-%m-%d}", "mtpipe": mtpipe.__version__}
    return about | {"recordings": choice.recordings} | made


def put_back(recorded: Path, results: Path) -> None:
    """Put recorded outcomes into the folder of results, which may have more of the same set.

    Raises
    ------
    SystemExit : they are of another set.
    """
    about = json.loads(recorded.read_text(encoding="utf-8").splitlines()[0])["about"]
    here = json.loads((results / "about.json").read_text(encoding="utf-8"))
    if any(about.get(key) != here.get(key) for key in ("seed", *FORM)):
        raise SystemExit(f"{recorded} holds results of another seed or form")
    for row in read_rows(recorded):
        name, number = row["answer"]["name"], row["answer"]["number"]
        files = {
            blind.outcome_file(results, number): json.dumps(row["outcome"]),
            blind.seal_file(results, name): row["sha256"] + "\n",
            results / "answers" / f"{name}.json": sealing.text_of(row["answer"]),
        }
        for path, text in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                path.write_text(text, encoding="utf-8")


def run_missing(choice: argparse.Namespace, numbers: Sequence[int]) -> None:
    """Run recordings that have no outcome yet, in order, until the time is over."""
    formula = None if choice.formula == "drawn" else choice.formula
    form = Form(frames=choice.frames, plateaus=choice.plateaus, formula=formula)
    missing = [n for n in numbers if not blind.outcome_file(choice.results, n).exists()]
    jobs = (blind.Job(choice.seed, n, form, choice.results) for n in missing)
    limit = float("inf") if choice.limit_minutes is None else 60 * choice.limit_minutes
    if choice.workers > 0 and missing:
        for i, said in enumerate(_done(jobs, choice.workers, time.monotonic() + limit)):
            print(f"{i + 1} of {len(missing)}: {said}", flush=True)


def _done(jobs: Iterator[blind.Job], workers: int, until: float) -> Iterator[str]:
    """What each job says when it is done; none begins after a time."""
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        running: set[Future[str]] = set()
        while True:
            while len(running) < workers and time.monotonic() < until:
                job = next(jobs, None)
                if job is None:
                    break
                running.add(pool.submit(blind.run, job))
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                trouble = future.exception()
                if isinstance(trouble, BrokenProcessPool):
                    raise trouble
                # failures of the diagnosis are outcomes; this one is the proof's own
                yield future.result() if trouble is None else f"could not be made ({trouble})"


def unsealed_rows(results: Path, numbers: Sequence[int]) -> list[dict[str, Any]]:
    """Outcomes that are there, each with its answer, which is the one that was sealed."""
    rows = []
    for number in numbers:
        path = blind.outcome_file(results, number)
        if path.exists():
            outcome = json.loads(path.read_text(encoding="utf-8"))
            name = outcome["name"]
            digest = blind.seal_file(results, name).read_text(encoding="utf-8").strip()
            answer = sealing.unsealed(results / "answers" / f"{name}.json", digest)
            rows.append({"sha256": digest, "answer": answer, "outcome": outcome})
    return rows


def write_rows(path: Path, about: dict[str, Any], rows: Sequence[dict[str, Any]]) -> None:
    """A line about the set, then a line per recording: answer and outcome."""
    lines = [{"about": about}, *rows]
    text = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines)
    path.write_text(text, encoding="utf-8")


def read_rows(path: Path) -> list[dict[str, Any]]:
    """What `write_rows` wrote; every answer is the one that was sealed."""
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()[1:]]
    for row in rows:
        if sealing.seal(row["answer"]) != row["sha256"]:
            name = row["answer"]["name"]
            raise sealing.BrokenSealError(f"{name} is not the answer that was sealed")
    return rows


def page_part(about: dict[str, Any], rows: Sequence[dict[str, Any]]) -> str:
    """What goes into the page: date, command, tables."""
    command = (
        f"python workflows/proof/proof.py --results DIR --recordings {about['recordings']} "
        f"--seed {about['seed']}"
    )
    command += "".join(
        f" --{key} {about[key]}" for key, usual in FORM.items() if about.get(key) != usual
    )
    scores = [score(row["answer"], row["outcome"]) for row in rows]
    printed = f"{about['date']}, mtpipe {about['mtpipe']}: `{command}`."
    unfinished = about["recordings"] - len(rows)
    if unfinished:
        printed += f" {unfinished} of {about['recordings']} recordings have not been run."
    return f"{printed}\n\n{tables.everything(scores)}"


if __name__ == "__main__":
    main()
