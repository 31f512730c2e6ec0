"""mtpipe's command in a process to which something happens at its k-th change of a file.

Python tells an audit hook of every file that is about to be opened, renamed or removed, and of
every folder that is about to be made or removed. A process is forked, as what it imports is there
then,
and does what `mtpipe` does with these arguments.
"""

from __future__ import annotations

import errno
import functools
import os
import pickle
import resource
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

# imported before a process is forked, which then need not
import plotly.offline  # noqa: F401

from mtpipe.calibration import calibration
from mtpipe.cli.entry import main
from mtpipe.pipeline import run as pipeline
from mtpipe.report import pages

# kill: before the change. within: as the file is written. full: no room from there on, neither for
# a file nor a folder. short: files from there on cannot become longer than LONGEST.
Kind = Literal["kill", "within", "full", "short"]
LONGEST = 64  # bytes; any file of a run is longer
# Events of Python's audit, and which of their arguments is the number of an open folder, to which a
# name may be relative.
FOLDER_AT = {"os.rename": 2, "os.remove": 1, "os.mkdir": 2, "os.rmdir": 1, "os.link": 2}
FILE_MADE, FOLDER_MADE = "open", "os.mkdir"
COUNTED: dict[Kind, tuple[str, ...]] = {
    "kill": (FILE_MADE, *FOLDER_AT),
    "within": (FILE_MADE,),
    "full": (FILE_MADE, FOLDER_MADE),
    "short": (FILE_MADE,),
}


@dataclass(frozen=True)
class Fault:
    """What happens at the `at`-th change (from 0) of those that are counted for its kind."""

    kind: Kind
    at: int


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code (negative: the signal), what it said on standard error."""

    code: int
    said: str


_templates = pages.templates


def _remembered(work: Callable[..., Any]) -> Callable[..., Any]:
    """A work that gives at once what it gave for the same arguments."""
    known: dict[bytes, Any] = {}

    @functools.wraps(work)
    def again(*args: Any) -> Any:
        key = pickle.dumps(args)
        if key not in known:
            known[key] = work(*args)
        return known[key]

    return again


def prepare(recording: Path, out: Path) -> None:
    """Make a run here, undisturbed; forked processes need not do again what changes no file.

    That is to calibrate beads and to compile the templates of the report.
    """
    for name in ("calibrate_bead", "measured_friction"):
        if not hasattr(getattr(calibration, name), "__wrapped__"):
            setattr(calibration, name, _remembered(getattr(calibration, name)))
    pages.templates = functools.cache(_templates)
    pipeline.run(recording, out, cross_check=False)


def command(arguments: Sequence[str], below: Path, fault: Fault | None = None) -> Ended:
    """Do a command, with a fault in what it changes below a folder."""
    return _forked(arguments, None if fault is None else _Hook(below, fault))


def changes(arguments: Sequence[str], below: Path, kind: Kind) -> int:
    """How many changes an undisturbed command makes, of those that count for a fault."""
    reading, writing = os.pipe()
    with open(reading, "rb") as told, open(writing, "wb") as tell:
        hook = _Hook(below, Fault(kind, sys.maxsize), lambda: os.write(tell.fileno(), b"."))
        ended = _forked(arguments, hook)
        tell.close()
        if ended.code != 0:
            raise RuntimeError(ended.said)
        return len(told.read())


def _forked(arguments: Sequence[str], hook: _Hook | None) -> Ended:
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.setsid()
        os.dup2(writing, 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        for end in (reading, writing):
            os.close(end)
        os._exit(_exit_code(arguments, hook))
    os.close(writing)
    with open(reading, "rb") as stream:
        said = stream.read().decode()
    return Ended(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), said)


def _exit_code(arguments: Sequence[str], hook: _Hook | None) -> int:
    """The exit code of the command in this process."""
    sys.argv = ["mtpipe", *arguments]
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if hook is not None:
        sys.addaudithook(hook)
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


class _Hook:
    """An audit hook that counts changes below a folder and brings the fault about."""

    def __init__(
        self, below: Path, fault: Fault, tell: Callable[[], object] = lambda: None
    ) -> None:
        self.below = below.resolve()
        self.fault = fault
        self.tell = tell
        self.counted = 0

    def __call__(self, event: str, arguments: tuple[object, ...]) -> None:
        if event not in COUNTED[self.fault.kind]:
            return
        path = _changed(event, arguments)
        if path is None or not path.is_relative_to(self.below):
            return
        self.tell()
        self.counted += 1
        if self.counted > self.fault.at:
            self._strike(path)

    def _strike(self, path: Path) -> None:
        if self.fault.kind == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.fault.kind == "full":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        # Python ignores the signal of a file that may not grow, which else ends a process at once
        kills = self.fault.kind == "within"
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL if kills else signal.SIG_IGN)
        _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (LONGEST, most))


def _changed(event: str, arguments: tuple[object, ...]) -> Path | None:
    """The file or folder that is about to be changed; None where it is only read."""
    name = arguments[0]
    if not isinstance(name, str | bytes | os.PathLike):
        return None
    folder = -1
    if event == FILE_MADE:
        flags = arguments[2]
        if not isinstance(flags, int) or not flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            return None
    elif isinstance(arguments[FOLDER_AT[event]], int):
        folder = int(str(arguments[FOLDER_AT[event]]))
    beside = Path.cwd() if folder < 0 else Path(os.readlink(f"/proc/self/fd/{folder}"))
    return Path(os.path.normpath(beside / os.fsdecode(name)))
