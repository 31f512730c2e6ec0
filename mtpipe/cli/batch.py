"""`mtpipe batch`: a folder of recordings at once, and how it is told how it goes on."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from mtpipe.ground.errors import writing
from mtpipe.ground.processes import Hear
from mtpipe.ground.streams import say, visible

if TYPE_CHECKING:
    from mtpipe.pipeline.recordings_below import Aside
    from mtpipe.pipeline.summary import Summary

# Most names of files in a line, and least seconds between two lines about a bead's progress.
MOST_NAMES, QUIET_S = 5, 30.0


def batch(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER",
            help="Folder: every recording below it that has a setup.toml beside it or above it.",
            exists=True,
            file_okay=False,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder to write.", file_okay=False)],
    seed: Annotated[int, typer.Option(help="Seed of posteriors and simulations.", min=0)] = 0,
    workers: Annotated[
        int | None,
        typer.Option(
            help="Beads at once: processes, or workers of a cluster; default: one per core.", min=1
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Work on a Dask cluster: tcp://HOST:8786."),
    ] = None,
    slurm: Annotated[
        bool, typer.Option("--slurm", help="Work in jobs of SLURM, as many as --workers.")
    ] = False,
) -> None:
    """Analyse every recording of a folder.

    Calibrates, cross-checks and diagnoses; continues where it was stopped.
    """
    from mtpipe.pipeline.batch import batch as whole

    if slurm and scheduler is not None:
        raise typer.BadParameter("give --scheduler or --slurm, not both")
    many = workers or os.cpu_count() or 1
    with shown_in_lines() as lines, writing(out), _pool(many, scheduler, slurm, lines.at) as pool:
        done = whole(folder, out, seed=seed, workers=many, pool=pool, watch=lines)
    _summary(done)
    raise typer.Exit(int(bool(done.failed)))


def _pool(
    jobs: int, scheduler: str | None, slurm: bool, hear: Hear
) -> AbstractContextManager[Executor | None]:
    """The cluster that is asked for; None: processes."""
    from mtpipe.ground import cluster

    if slurm:
        return cluster.slurm(jobs, hear)
    return nullcontext() if scheduler is None else cluster.scheduler(scheduler, hear)


class Lines:
    """How a batch goes on, in lines on standard error; on a terminal the last one is a bar."""

    def __init__(self, bar: Progress, task: TaskID) -> None:
        self._bar, self._task = bar, task
        self._counted, self._said_s = "", -math.inf

    def aside(self, files: Sequence[Aside]) -> None:
        """Files that are no recordings, those with the same reason together."""
        reasons: dict[str, list[str]] = {}
        for file in files:
            reasons.setdefault(file.why, []).append(file.name)
        for why, names in reasons.items():
            shown = ", ".join(names[:MOST_NAMES])
            more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
            self._say(f"left aside: {shown}{more} ({why})")

    def at(self, what: str) -> None:
        """What a bead or recording is at."""
        if self._bar.disable:
            # every one would be a hundred lines a bead
            if time.monotonic() - self._said_s > QUIET_S:
                self._say(what)
        else:
            self._bar.update(self._task, what=visible(what))

    def counted(self, what: str, done: int, total: int, left_s: float | None) -> None:
        """`done` of `total` beads or recordings are done; `left_s`: seconds left, if known."""
        left = "" if left_s is None else f"about {_duration(left_s)} left"
        line = f"{done} of {total} {what}{', ' if left else ''}{left}"
        if self._bar.disable and self._counted.partition(",")[0] != line.partition(",")[0]:
            self._say(line)
        self._counted = line
        self._bar.update(self._task, completed=done, total=max(total, 1), step=what, left=left)

    def failed(self, name: str, why: str) -> None:
        """A recording that could not be worked on."""
        self._say(f"{name}: {why}")

    def calibrated(self, name: str, plateaus: int, *, complete: bool) -> None:
        """The number of plateaus that have forces now, in a recording that arrives."""
        how = "complete" if complete else "still being recorded"
        self._say(f"{name}: {plateaus} plateau{'s' * (plateaus != 1)} calibrated, {how}")

    def _say(self, line: str) -> None:
        self._said_s = time.monotonic()
        self._bar.console.print(visible(line), soft_wrap=True, markup=False, highlight=False)


@contextmanager
def shown_in_lines() -> Iterator[Lines]:
    """Show how a batch goes on."""
    console = Console(stderr=True)
    with Progress(
        TextColumn("{task.fields[step]}", markup=False),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f}", markup=False),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]} {task.fields[what]}", markup=False),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        yield Lines(bar, bar.add_task("", total=1, step="looking", left="", what=""))


def _duration(seconds: float) -> str:
    """A time in a unit that suits it."""
    for unit, length_s in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * length_s:
            return f"{seconds / length_s:.0f} {unit}"
    return f"{seconds:.0f} s"


def _summary(done: Summary) -> None:
    """Print how many beads there are of each verdict, what failed, and where the summary is."""
    from mtpipe.pipeline.summary import PAGE
    from mtpipe.report.findings import overview

    say(overview(row.verdict for row in done.rows if row.verdict))
    for row in done.failed:
        say(f"{row.recording}{f' {row.bead}' if row.bead else ''} failed: {row.reasons}")
    say(f"Summary: {done.out / PAGE}")
