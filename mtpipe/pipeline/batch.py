"""A folder of recordings at once: each of them a run, their beads side by side.

First all recordings are calibrated, then beads are cross-checked; the summary is written anew as
each recording ends. What a run is of its content says (`pipeline.identity`), so a batch that was
stopped needs no list of its own: complete runs are left as they are, and the others go on from
their journals.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeGuard

import pandas as pd

from mtpipe.ground.enduring import enduring_executor
from mtpipe.ground.errors import MtpipeError, unforeseen
from mtpipe.ground.processes import Workers
from mtpipe.ground.steps import Steps, side_by_side
from mtpipe.pipeline.identity import Asked, identity
from mtpipe.pipeline.magnet_curve import told_magnet_curve
from mtpipe.pipeline.recordings_below import Aside, There, recordings_below
from mtpipe.pipeline.results import Run
from mtpipe.pipeline.run import CHECKED_BEADS, KEPT_BEADS, running
from mtpipe.pipeline.summary import Row, Summary, is_done, rows_of, write_summary
from mtpipe.report.run_folder import clear_journals, make_ready, told

# Works that wait for each process, so that none of them waits for the next recording to be read.
AHEAD = 2
# What a disc says that takes no more of any recording.
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


class Watch(Protocol):
    """Whoever is told how a batch goes on."""

    def aside(self, files: list[Aside]) -> None:
        """Files that are no recordings."""

    def at(self, what: str) -> None:
        """What a bead or recording is at."""

    def counted(self, what: str, done: int, total: int, left_s: float | None) -> None:
        """`done` of `total` beads or recordings are done; `left_s`: seconds left, if known."""

    def failed(self, name: str, why: str) -> None:
        """A recording that could not be worked on."""


def batch(
    folder: Path | str,
    out: Path | str,
    *,
    seed: int = 0,
    workers: int = 1,
    pool: Workers | None = None,
    watch: Watch,
) -> Summary:
    """Calibrate, cross-check and diagnose every recording below a folder.

    Parameters
    ----------
    folder : recordings are found by `recordings_below`.
    out : folder to write: `summary.csv`, `index.html`, and a run's folder for each recording.
    seed : of posteriors and simulations.
    workers : processes, or how many works a pool does at once.
    pool : does it in their place.
    watch : is told how it goes on.

    Raises
    ------
    MtpipeError : there is no recording, the folder cannot be written, or workers were ended.
    """
    folder, out = Path(folder), Path(out)
    if out.resolve() == folder.resolve():
        raise MtpipeError(
            "is the folder of the recordings", where=str(out), mend="Choose another --out."
        )
    there, aside = recordings_below(folder, out.resolve())
    watch.aside(aside)
    if not there:
        raise MtpipeError(
            "there is no recording with a setup.toml beside it or above it", where=str(folder)
        )
    make_ready(out)
    day = Day(out, there, aside, seed, watch)
    with enduring_executor(workers if pool is None else pool, hear=watch.at) as spread:
        for works in (day.calibrations, day.checks):
            for one, result in side_by_side(works(spread, workers), AHEAD * workers):
                day.ended(one, result)
    return day.with_curve()


@dataclass
class Day:
    """The recordings of a folder, and how far each is, by name.

    Attributes
    ----------
    content : what each has to be a run of. failures : why there is none. rows : of the summary.
    beads : how many there are. checked : how many of them are. kept : how many were before.
    magnet : what is said of the magnet's curve.
    """

    out: Path
    there: list[There]
    aside: list[Aside]
    seed: int
    watch: Watch
    content: dict[str, str] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    rows: dict[str, list[Row]] = field(default_factory=dict)
    beads: dict[str, int] = field(default_factory=dict)
    checked: dict[str, int] = field(default_factory=dict)
    kept: dict[str, int] = field(default_factory=dict)
    began: float = 0.0
    magnet: str = ""

    def calibrations(self, pool: Executor, workers: int) -> Iterator[tuple[There, Steps[Run]]]:
        """Works of the recordings of whose content there are no forces yet."""
        for one in self.there:
            try:
                self.content[one.name] = identity(self.asked(one))
            except Exception as error:
                self.ended(one, error)
                continue
            if self.told(one):
                self.ended(one)
            else:
                yield one, self._run(one, pool, workers, only_forces=True)

    def checks(self, pool: Executor, workers: int) -> Iterator[tuple[There, Steps[Run]]]:
        """Works of the recordings that are calibrated, and not cross-checked."""
        waiting = [one for one in self.there if (run := self.told(one)) and not is_done(run)]
        for one in waiting:
            table = pd.read_parquet(self.out / one.name / "beads.parquet", columns=["plateaus"])
            self.beads[one.name] = int((table["plateaus"] > 0).sum())
        self.began = time.monotonic()
        for number, one in enumerate(waiting):
            # the last recordings may spread each bead over several processes
            share = max(1, workers // (len(waiting) - number))
            yield one, self._run(one, pool, share, only_forces=False)

    def ended(self, one: There, result: Run | Exception | None = None) -> None:
        """Take what came of a recording.

        Raises
        ------
        Exception : one that is no matter of this recording alone.
        """
        if isinstance(result, BrokenExecutor) or self._cannot_write(result):
            raise result
        if isinstance(result, Exception):
            known = isinstance(result, MtpipeError)
            self.failures[one.name] = str(result) if known else unforeseen(result)
            self.watch.failed(one.name, self.failures[one.name])
            self._count(one.name, self.beads.get(one.name, 0))
        elif is_done(self.told(one)):
            clear_journals(self.out / one.name)
        failure, name = self.failures.get(one.name, ""), one.name
        self.rows[name] = rows_of(name, self.out / name, self.told(one), failure)
        if not self.began:
            self.watch.counted("recordings calibrated", len(self.rows), len(self.there), None)
        self.write()

    def with_curve(self) -> Summary:
        """Write the magnet's curve of all runs that are there, and the summary with it."""
        runs = {one.name: self.out / one.name for one in self.there if self.told(one)}
        self.magnet = told_magnet_curve(self.out, runs)
        return self.write()

    def write(self) -> Summary:
        """Write the summary as it is now."""
        rows = [
            self.rows.get(one.name) or rows_of(one.name, self.out, {}, "") for one in self.there
        ]
        aside = tuple((one.name, one.why) for one in self.aside)
        summary = Summary(self.out, tuple(row for some in rows for row in some), aside, self.magnet)
        write_summary(summary)
        return summary

    def asked(self, one: There) -> Asked:
        """What the run of a recording is asked for."""
        return Asked(one.path, self.out / one.name, one.setup, self.seed, overwrite=True)

    def told(self, one: There) -> dict[str, Any]:
        """`run.json` where it is of the content that is asked for, else nothing."""
        earlier = told(self.out / one.name)
        mine = one.name in self.content and earlier.get("content") == self.content[one.name]
        return earlier if mine else {}

    def _run(self, one: There, pool: Executor, workers: int, *, only_forces: bool) -> Steps[Run]:
        def say(step: str, done: int, total: int) -> None:
            if step == KEPT_BEADS:
                self.kept[one.name] = done
            elif step == CHECKED_BEADS:
                self._count(one.name, done)
            else:
                self.watch.at(f"{one.name}: {step}")

        return running(
            self.asked(one), pool, workers=workers, only_forces=only_forces, progress=say
        )

    def _count(self, name: str, checked: int) -> None:
        self.checked[name] = checked
        done, total = sum(self.checked.values()), sum(self.beads.values())
        worked = done - sum(self.kept.values())
        left_s = (time.monotonic() - self.began) / worked * (total - done) if worked > 0 else None
        if total:
            self.watch.counted("beads cross-checked", done, total, left_s)

    def _cannot_write(self, error: object) -> TypeGuard[OSError]:
        if not isinstance(error, OSError):
            return False
        inside = error.filename is not None
        inside = inside and Path(os.fsdecode(error.filename)).is_relative_to(self.out)
        return inside or error.errno in NO_ROOM
