"""What the command line shows: a progress bar on a terminal, a summary of a run, how it stopped.

Names of beads and files are words and nothing else: no markup, no codes that a terminal obeys.
"""

from __future__ import annotations

import io
import math
import multiprocessing
import shlex
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from mtpipe.ground.files import as_text
from mtpipe.ground.streams import visible

if TYPE_CHECKING:
    from mtpipe.ground.types import NamedProgress


# Windows has no SIGHUP, which a terminal sends as it closes.
STOPPING = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM", "SIGHUP": "the end of its terminal"}


class Stopped(BaseException):
    """A signal to end. No `KeyboardInterrupt`, for which libraries have a way of their own."""


@contextmanager
def stopped_in_one_line() -> Iterator[None]:
    """Let Ctrl-C, SIGTERM and SIGHUP end the workers and then the program, with one line.

    The exit code is 128 and the number of the signal. What is ignored from the start (nohup) stays
    so. To be used in the main thread.
    """
    stdout, stderr = sys.stdout, sys.stderr
    heard: list[signal.Signals] = []
    before: dict[signal.Signals, Any] = {}

    def stop(number: int, _frame: FrameType | None) -> None:
        # what follows is short, and leaves no half-written file if it is let finish
        for one in before:
            signal.signal(one, signal.SIG_IGN)
        heard.append(signal.Signals(number))
        for worker in multiprocessing.active_children():
            worker.terminate()
        # emcee prints its parameters and a traceback before it passes an exception on
        sys.stdout = sys.stderr = io.StringIO()
        raise Stopped

    for name in STOPPING:
        one = getattr(signal, name, None)
        if one is not None and signal.getsignal(one) != signal.SIG_IGN:
            before[one] = signal.signal(one, stop)
    try:
        yield
    except Stopped:
        sys.stdout, sys.stderr = stdout, stderr
        print(f"mtpipe: stopped by {STOPPING[heard[0].name]}", file=stderr)
        sys.exit(128 + heard[0])
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


@contextmanager
def progress_bar() -> Iterator[NamedProgress]:
    """A callback that draws a bar on standard error where that is a terminal, else is silent."""
    console = Console(stderr=True)
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f}", markup=False),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task("starting", total=1)

        def advance(step: str, done: int, total: int) -> None:
            bar.update(task, description=visible(step), completed=done, total=max(total, 1))

        yield advance


def quoted(path: Path) -> str:
    """A path as it is written in a shell."""
    return shlex.quote(as_text(str(path)))


def summary(out: Path) -> None:
    """Print a run's table of beads, then what was found, and last where the report is.

    Parameters
    ----------
    out : the run's folder, as in docs/run-folder.md.
    """
    from mtpipe.report import words
    from mtpipe.report.findings import bead_finding, mixed_plateaus
    from mtpipe.report.folder import read_run_folder, records
    from mtpipe.report.notices import is_foremost, told_once

    run = read_run_folder(out)
    console = Console(highlight=False, markup=False, emoji=False)
    beads = records(run.beads)
    console.print(_table(beads))
    tethered = {bead["bead"] for bead in beads}
    foremost = [n for n in run.notices if n.bead not in tethered and is_foremost(n)]
    general = [one.message for one in told_once(foremost)]
    blocks: dict[tuple[str, ...], list[str]] = {}
    for bead in beads:
        found = bead_finding(run, bead)
        change = [f"As the setup states it → to quote: {found.change}."] if found.change else []
        note = [found.note] if found.note else []
        opening = f"{bead['verdict']}. {found.headline}"
        lines = (opening, *found.details, *note, *change, *found.reasons)
        blocks.setdefault(lines, []).append(bead["bead"])
    for line in [*mixed_plateaus(run), *general]:
        _say(console, line)
    for lines, names in blocks.items():
        _say(console, f"{words.few(names)}: {lines[0]}")
        for line in lines[1:]:
            _say(console, f"  {line}")
    _say(console, f"Report: {out / 'report' / 'index.html'}")


def _say(console: Console, line: str) -> None:
    console.print(visible(line), soft_wrap=True)


def _table(beads: Sequence[Mapping[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in (
        "bead",
        "verdict",
        "plateaus",
        "force (pN)",
        "contour (nm)",
        "persistence (nm)",
    ):
        table.add_column(heading)
    for row in beads:
        table.add_row(
            visible(str(row["bead"])),
            str(row["verdict"]),
            f"{row['plateaus_used']} of {row['plateaus']}",
            _range(row["force_min_pN"], row["force_max_pN"]),
            _with_error(row["contour_length_nm"], row["contour_length_stderr_nm"]),
            _with_error(row["persistence_length_nm"], row["persistence_length_stderr_nm"]),
        )
    return table


def _range(low: float, high: float) -> str:
    return "-" if math.isnan(low) else f"{low:.3g} to {high:.3g}"


def _with_error(value: float, stderr: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4g} ± {stderr:.2g}"
