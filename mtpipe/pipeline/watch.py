"""A folder in which recordings arrive: forces of each plateau as it ends.

The folder is looked at again and again. What has not changed for a while is complete, and is a run
as a batch makes it before its cross-checks; so a batch of the same folders goes on from there. What
grows is taken up to its last plateau that has ended. Whatever cannot be read while it grows waits:
only of what is complete is it said that it cannot be read.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from mtpipe.ground.enduring import enduring_executor
from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.steps import Steps, side_by_side
from mtpipe.ground.types import NamedProgress
from mtpipe.pipeline.batch import AHEAD, Day, Watch
from mtpipe.pipeline.growing import load_growing
from mtpipe.pipeline.identity import files_of, identity
from mtpipe.pipeline.recordings_below import There, recordings_below
from mtpipe.pipeline.results import Run
from mtpipe.pipeline.run import running
from mtpipe.pipeline.summary import Summary
from mtpipe.report.run_folder import make_ready

# Seconds from one look at the folder to the next: a plateau lasts longer.
EVERY_S = 1.0
# Seconds after which what has not changed is complete. Programs write at least as often.
SETTLED_S = 10.0
Files = tuple[tuple[str, int, int], ...]


class Follower(Watch, Protocol):
    """Whoever is told of recordings as they arrive."""

    def calibrated(self, name: str, plateaus: int, *, complete: bool) -> None:
        """The number of plateaus of a recording that have forces now."""


@dataclass
class _Seen:
    """What was last seen of a recording.

    Attributes
    ----------
    files : name, bytes and time of change of each. since : when they were first seen so.
    looked : files as they were when they were last read. ended : the last frame that has a force.
    done : whether nothing more can be done before files change.
    """

    files: Files = ()
    since: float = 0.0
    looked: Files = ()
    ended: int = 0
    done: bool = False


def watch(
    folder: Path | str,
    out: Path | str,
    *,
    seed: int = 0,
    workers: int = 1,
    settled_s: float = SETTLED_S,
    idle_s: float | None = None,
    tell: Follower,
) -> Summary:
    """Calibrate every recording below a folder, as it arrives, plateau by plateau.

    Parameters
    ----------
    folder, out, seed, workers : as of `pipeline.batch.batch`.
    settled_s : a recording is complete once its files have not changed for this time.
    idle_s : end once all is calibrated and nothing has changed for this time; None: never.
    tell : is told how it goes on.

    Raises
    ------
    MtpipeError : a folder cannot be read or written.
    """
    folder, out = Path(folder), Path(out)
    if out.resolve() == folder.resolve():
        raise MtpipeError(
            "is the folder of the recordings", where=str(out), mend="Choose another --out."
        )
    make_ready(out)
    arrivals = _Arrivals(folder, Day(out, [], [], seed, tell), tell, settled_s)
    with enduring_executor(workers, hear=tell.at) as pool:
        while True:
            began, pause_s = time.monotonic(), 0.0
            arrivals.look()
            for one, result in side_by_side(arrivals.works(pool, workers), AHEAD * workers):
                arrivals.ended(one, result)
                pause_s = EVERY_S
            if idle_s is not None and arrivals.idle_for(time.monotonic()) >= idle_s:
                return arrivals.day.with_curve()
            # a long recording that is read for nothing leaves the machine as much time as it takes
            time.sleep(pause_s or max(EVERY_S, time.monotonic() - began))


@dataclass
class _Arrivals:
    """The recordings of a folder as they arrive.

    Attributes
    ----------
    seen : of each recording, by name. changed : when anything did last. aside : named already.
    under_way : whether the run that is being made of a recording is of all of it.
    """

    folder: Path
    day: Day
    tell: Follower
    settled_s: float
    seen: dict[str, _Seen] = field(default_factory=dict)
    changed: float = field(default_factory=time.monotonic)
    aside: set[str] = field(default_factory=set)
    under_way: dict[str, bool] = field(default_factory=dict)

    def look(self) -> None:
        """See which recordings there are, and which files have changed."""
        there, aside = recordings_below(self.folder, self.day.out.resolve())
        self.day.there, self.day.aside = there, aside
        fresh = [one for one in aside if one.name not in self.aside and self._settled(one.name)]
        self.aside |= {one.name for one in fresh}
        self.tell.aside(fresh)
        names = {one.name for one in there}
        self.day.rows = {name: rows for name, rows in self.day.rows.items() if name in names}
        for one in there:
            files, before = _state(self._files(one)), self.seen.get(one.name)
            if before is None or files != before.files:
                since = _since(files) if before is None else time.monotonic()
                seen = self.seen.setdefault(one.name, _Seen())
                seen.files, seen.since, seen.done = files, since, False
                self.changed = time.monotonic()

    def works(self, pool: Executor, workers: int) -> Iterator[tuple[There, Steps[Run]]]:
        """Runs to be made now: of what grows, and of one that is complete.

        One, as plateaus of others may end while it is calibrated.
        """
        complete = None
        for one in self.day.there:
            seen = self.seen[one.name]
            if seen.done:
                continue
            if time.monotonic() - seen.since >= self.settled_s:
                complete = complete or one
            elif seen.files != seen.looked:
                yield from self._grown(one, pool, workers)
        if complete is not None:
            yield from self._complete(complete, pool, workers)

    def ended(self, one: There, result: Run | Exception) -> None:
        """Take what came of a run."""
        complete, known = self.under_way[one.name], isinstance(result, MtpipeError)
        if not complete and known and not isinstance(result, BrokenExecutor):
            self.tell.at(f"{one.name} waits: {result}")
            return
        self.day.failures.pop(one.name, None)
        self.day.ended(one, result)
        self.seen[one.name].done = complete
        self.changed = time.monotonic()
        if isinstance(result, Run):
            plateaus = len(result.recording.plateaus)
            self.tell.calibrated(one.name, plateaus, complete=complete)
            if complete:
                self.day.with_curve()

    def idle_for(self, now: float) -> float:
        """Seconds since anything changed; less than none while something waits."""
        waits = any(not self.seen[one.name].done for one in self.day.there)
        waits |= any(one.name not in self.aside for one in self.day.aside)
        return -1.0 if waits else now - self.changed

    def _grown(
        self, one: There, pool: Executor, workers: int
    ) -> Iterator[tuple[There, Steps[Run]]]:
        seen, asked = self.seen[one.name], replace(self.day.asked(one), growing=True)
        seen.looked = seen.files
        try:
            if asked.film:  # images are tracked once they are all there
                return
            raw = load_growing(one.path, one.setup)
            self.day.content[one.name] = identity(asked)
        except Exception as error:  # half a file may be wrong in any way
            self.tell.at(f"{one.name} waits: {error}")
            return
        if len(raw.time_s) == seen.ended:
            return
        seen.ended, self.under_way[one.name] = len(raw.time_s), False
        say = self._progress(one)
        yield one, running(asked, pool, workers=workers, only_forces=True, raw=raw, progress=say)

    def _complete(
        self, one: There, pool: Executor, workers: int
    ) -> Iterator[tuple[There, Steps[Run]]]:
        asked, self.under_way[one.name] = self.day.asked(one), True
        try:
            self.day.content[one.name] = identity(asked)
        except Exception as error:
            self.ended(one, error)
            return
        if self.day.told(one):
            self.seen[one.name].done = True
            self.day.ended(one)
            return
        say = self._progress(one)
        yield one, running(asked, pool, workers=workers, only_forces=True, progress=say)

    def _progress(self, one: There) -> NamedProgress:
        return lambda step, done, total: self.tell.at(f"{one.name}: {step}")

    def _files(self, one: There) -> list[Path]:
        """All files that decide what becomes of a recording, as far as they can be told now."""
        try:
            return [*files_of(self.day.asked(one)), one.setup]
        except Exception:  # half a file may be wrong in any way
            return [one.path, one.setup]

    def _settled(self, name: str) -> bool:
        files = _state([self.folder / name])
        return time.monotonic() - _since(files) >= self.settled_s


def _state(files: list[Path]) -> Files:
    found = []
    for file in files:
        try:
            status = file.stat()
        except OSError:  # it went as it was looked at
            continue
        found.append((str(file), status.st_size, status.st_mtime_ns))
    return tuple(found)


def _since(files: Files) -> float:
    """When files that are seen for the first time changed last, by the clock of `monotonic`.

    By their time stamps, and not in the future, as another machine's clock may have it.
    """
    newest = max((changed for _, _, changed in files), default=0) / 1e9
    return time.monotonic() - max(0.0, time.time() - newest)
