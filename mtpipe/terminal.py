"""What the command line shows: a progress bar on a terminal, a summary of a run, how it stopped."""

from __future__ import annotations

import io
import math
import multiprocessing
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

if TYPE_CHECKING:
    from mtpipe.pipeline import Progress as Callback


STOPPED_CODE = 128 + signal.SIGINT


class Stopped(BaseException):
    """Ctrl-C. No `KeyboardInterrupt`, for which libraries have a way of their own."""


@contextmanager
def stopped_in_one_line() -> Iterator[None]:
    """Let Ctrl-C end the workers and then the program, with one line and the exit code 130.

    To be used in the main thread.
    """
    stdout, stderr = sys.stdout, sys.stderr

    def stop(_number: int, _frame: FrameType | None) -> None:
        # what follows is short, and leaves no half-written file if it is let finish
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for worker in multiprocessing.active_children():
            worker.terminate()
        # emcee prints its parameters and a traceback before it passes an exception on
        sys.stdout = sys.stderr = io.StringIO()
        raise Stopped

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    except Stopped:
        sys.stdout, sys.stderr = stdout, stderr
        print("mtpipe: stopped by Ctrl-C", file=stderr)
        sys.exit(STOPPED_CODE)
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def progress_bar() -> Iterator[Callback]:
    """A callback that draws a bar on standard error where that is a terminal, else is silent."""
    console = Console(file=sys.stderr)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task("starting", total=1)

        def advance(step: str, done: int, total: int) -> None:
            bar.update(task, description=step, completed=done, total=max(total, 1))

        yield advance


def summary(out: Path) -> None:
    """Print a run's table of beads, then what was found, and last where the report is.

    Parameters
    ----------
    out : the run's folder, as in docs/run-folder.md.
    """
    from mtpipe.report import words
    from mtpipe.report.findings import bead_finding, mixed_plateaus
    from mtpipe.report.folder import read_run_folder, records
    from mtpipe.report.notices import is_foremost

    run = read_run_folder(out)
    console = Console(highlight=False)
    beads = records(run.beads)
    console.print(_table(beads))
    tethered = {bead["bead"] for bead in beads}
    general = [n.message for n in run.notices if n.bead not in tethered and is_foremost(n)]
    blocks: dict[tuple[str, ...], list[str]] = {}
    for bead in beads:
        found = bead_finding(run, bead)
        change = [f"As configured → to quote: {found.change}."] if found.change else []
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
    console.print(line, soft_wrap=True, markup=False)


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
            str(row["bead"]),
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
