"""Read thousands of damaged and odd inputs by every reader, and count what comes of them.

    python workflows/fuzz/study.py --inputs 10000 [--readers csv hdf5] [--shard 0/2]
    python workflows/fuzz/study.py --only csv --input 17

Every input is read in a process with 4 GiB of memory and 20 s of time. It ends fine, with one
sentence of mtpipe's, with another exception (or a sentence of several lines), not at all (hang),
with the process's end (abort), or for want of memory. What is done is kept in --state, and a study
that was stopped goes on from there. The exit code is 1 if there is any of the last four.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import shutil
import sys
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from tempfile import mkdtemp

import readers
from case import case_of
from worker import BAD, OUTCOMES, serve

NAMES = tuple(readers.BY_NAME)
# Time that an input may take, of the processor: other programs may keep a computer busy. One that
# waits for ever uses none, and has so long by the clock. A process may start when it can.
SECONDS = 20.0
WAITING_SECONDS = 300.0
# A process is replaced after so many inputs, as libraries leak.
INPUTS_EACH = 1000
Answer = tuple[str, str]


class Worker:
    """A process that reads, started anew after it ended or hung."""

    def __init__(self) -> None:
        self._process: multiprocessing.process.BaseProcess | None = None
        self._done = 0

    def outcome(self, reader: str, number: int) -> Answer:
        """What comes of one input; a bad end is looked at again in a new process."""
        answer = self._read(reader, number)
        if answer[0] in ("hang", "memory"):  # may be the fault of a busy computer, or of a leak
            self.stop()
            answer = self._read(reader, number)
        return answer

    def stop(self) -> None:
        """End the process and remove its files."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            shutil.rmtree(self._folder, ignore_errors=True)
            self._process = None

    def _start(self) -> None:
        context = multiprocessing.get_context("fork")  # what readers import is there then
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()
        self._folder = str(self._connection.recv())
        self._done = 0

    def _read(self, reader: str, number: int) -> Answer:
        if self._process is None or self._done >= INPUTS_EACH:
            self.stop()
            self._start()
        self._done += 1
        self._connection.send((reader, number))
        try:
            begun = self._connection.recv()
            if begun != "begun":
                raise RuntimeError(begun)
            return self._answer()
        except TimeoutError:
            self.stop()
            return "hang", f"longer than {SECONDS:g} s"
        except EOFError:
            assert self._process is not None
            self._process.join()
            code = self._process.exitcode
            self.stop()
            return "abort", f"exit code {code}"

    def _answer(self) -> Answer:
        assert self._process is not None
        started, used = time.monotonic(), processor_seconds(self._process.pid)
        while not self._connection.poll(1.0):
            late = time.monotonic() - started > WAITING_SECONDS
            if late or processor_seconds(self._process.pid) - used > SECONDS:
                raise TimeoutError
        answer: Answer = self._connection.recv()
        return answer


def processor_seconds(process: int | None) -> float:
    """Time of the processor that a process has used (Linux); 0 of one that is gone."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def done(state: Path, reader: str) -> dict[int, Answer]:
    """Outcomes of a reader's inputs, by number; of several the last counts."""
    found: dict[int, Answer] = {}
    for file in sorted(state.glob(f"{reader}.*.jsonl")):
        for line in file.read_text(encoding="utf-8").splitlines():
            try:
                number, outcome, said = json.loads(line)
            except ValueError:  # the line in which a study was stopped
                continue
            found[number] = (outcome, said)
    return found


def study(worker: Worker, log: Path, reader: str, numbers: Iterable[int]) -> None:
    """Read inputs and append what comes of them to a file."""
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("a", encoding="utf-8") as stream:
        for number in numbers:
            outcome, said = worker.outcome(reader, number)
            kept = said if outcome in BAD else ""
            stream.write(f"\n{json.dumps([number, outcome, kept])}")
            stream.flush()
            if outcome in BAD:
                print(f"{reader} {number}: {outcome}: {said}", flush=True)


def table(state: Path, readers: list[str]) -> tuple[str, int]:
    """Reader by outcome, as Markdown, and the number of bad outcomes."""
    lines = [f"| reader | inputs | {' | '.join(OUTCOMES)} |", "| --- " * 8 + "|"]
    bad = 0
    for reader in readers:
        counts = Counter(outcome for outcome, _ in done(state, reader).values())
        cells = [counts.total(), *(counts[outcome] for outcome in OUTCOMES)]
        lines.append(f"| {reader} | {' | '.join(str(n) for n in cells)} |")
        bad += sum(counts[outcome] for outcome in BAD)
    return "\n".join(lines), bad


def one(worker: Worker, reader: str, number: int) -> int:
    """Read one input, and keep its files."""
    folder = Path(mkdtemp(prefix="fuzz-input"))
    case_of(readers.BY_NAME[reader], number).write(folder)
    outcome, said = worker.outcome(reader, number)
    print(f"{reader} {number}: {outcome}: {said}\nits files: {folder}")
    return int(outcome in BAD)


def main() -> int:
    """Run the study, print its table."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--inputs", type=int, default=10_000, help="of each reader")
    arguments.add_argument("--readers", nargs="+", choices=NAMES, default=list(NAMES))
    arguments.add_argument(
        "--shard", default="0/1", help="I/N: every N-th input, from I (0 to N-1)"
    )
    arguments.add_argument("--state", type=Path, default=Path("fuzz-state"), help="what is done")
    arguments.add_argument("--again", action="store_true", help="read what ended badly once more")
    arguments.add_argument("--only", choices=NAMES, help="one reader, with --input")
    arguments.add_argument("--input", type=int, default=0, help="number of its input")
    asked = arguments.parse_args()
    worker = Worker()
    try:
        if asked.only:
            return one(worker, asked.only, asked.input)
        first, shards = map(int, asked.shard.split("/"))
        for reader in asked.readers:
            kept = done(asked.state, reader)
            if asked.again:
                kept = {n: answer for n, answer in kept.items() if answer[0] not in BAD}
            left = [n for n in range(first, asked.inputs, shards) if n not in kept]
            log = asked.state / f"{reader}.{first}-of-{shards}.jsonl"
            study(worker, log, reader, left)
    finally:
        worker.stop()
    text, bad = table(asked.state, asked.readers)
    print(text)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
