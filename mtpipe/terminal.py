"""What the command line shows: a progress bar on a terminal, a summary of a run, how it stopped."""

from __future__ import annotations

import io
import math
import multiprocessing
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

if TYPE_CHECKING:
    from mtpipe.pipeline import Progress as Callback
    from mtpipe.pipeline import Run


NAMES_SHOWN = 4
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


def summary(run: Run, out: Path) -> None:
    """Print a table of beads, what is worth worrying about, and where the report is."""
    from mtpipe.tables import beads_table

    console = Console(highlight=False)
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
    tracked = run.recording.tracked
    beads = beads_table(run.calibration, run.forces, run.verdicts, run.curves, tracked)
    for row in beads.to_dict("records"):
        table.add_row(
            str(row["bead"]),
            str(row["verdict"]),
            f"{row['plateaus_used']} of {row['plateaus']}",
            _range(row["force_min_pN"], row["force_max_pN"]),
            _with_error(row["contour_length_nm"], row["contour_length_stderr_nm"]),
            _with_error(row["persistence_length_nm"], row["persistence_length_stderr_nm"]),
        )
    console.print(table)
    grouped: dict[str, list[str]] = {}
    for verdict in run.verdicts:
        for reason in verdict.reasons:
            grouped.setdefault(reason, []).append(verdict.bead)
    # what concerns no tethered bead: the recording as a whole, or a reference bead
    own = {verdict.bead for verdict in run.verdicts}
    general = [
        n.message
        for n in run.notices
        if n.bead not in own and n.severity != "info" and n.message not in grouped
    ]
    lines = [f"{_names(beads)}: {reason}" for reason, beads in grouped.items()]
    for line in [*lines, *_unchecked(run), *general]:
        console.print(line, soft_wrap=True, markup=False)
    console.print(f"Report: {out / 'report' / 'index.html'}", soft_wrap=True, markup=False)


def _unchecked(run: Run) -> list[str]:
    """Why beads are unchecked, in a line for all of them, or for each its reason."""
    beads = [one.bead for one in run.verdicts if one.verdict == "unchecked"]
    if run.checked is None:
        why = "not cross-checked (--no-crosscheck), and no bead is called good without that"
        return [f"{_names(beads)}: {why}"] if beads else []
    return [
        f"{bead}: it was not cross-checked: {reason}"
        for bead, reason in run.checked.refused.items()
        if bead in beads
    ]


def _names(beads: list[str]) -> str:
    """A few names in full, many by their number."""
    if len(beads) <= NAMES_SHOWN:
        return ", ".join(beads)
    return f"{', '.join(beads[:NAMES_SHOWN])} and {len(beads) - NAMES_SHOWN} more"


def _range(low: float, high: float) -> str:
    return "-" if math.isnan(low) else f"{low:.3g} to {high:.3g}"


def _with_error(value: float, stderr: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4g} ± {stderr:.2g}"
