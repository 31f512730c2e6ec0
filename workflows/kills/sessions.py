"""A command in a session of its own, whose processes can be counted and killed.

Looks into /proc.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

PATIENCE_S = 20.0
LOOKS_S = 0.05


def started(arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    """`python -m mtpipe` in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "mtpipe", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def workers(session: int) -> list[int]:
    """The processes of a session that calculate for the first of it."""
    found = []
    for pid in members(session):
        with suppress(OSError):
            if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes():
                found.append(pid)
    return found


def kill_worker(session: int) -> None:
    """Kill one of a session's workers, if it has any."""
    for pid in workers(session)[:1]:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def members(session: int) -> list[int]:
    """The running processes of a session; one that has ended and waits to be asked for is none."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, _, its_session, *_ = stat.read_text().rpartition(")")[2].split()
            if int(its_session) == session and state not in "ZX":
                found.append(int(stat.parent.name))
    return found


def wait_until_spent(process: subprocess.Popen[bytes], seconds: float) -> None:
    """Wait until a session has taken so much processor time, or has ended.

    Unlike the time of a clock that is the same moment of the work on a busy machine too.
    """
    while process.poll() is None and _spent_s(process.pid) < seconds:
        time.sleep(LOOKS_S)


def _spent_s(session: int) -> float:
    """Processor time of a session's processes, and of those of their own that have ended."""
    ticks = 0
    for pid in members(session):
        with suppress(OSError):
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            ticks += sum(int(field) for field in fields[11:15])
    return ticks / os.sysconf("SC_CLK_TCK")


def left(session: int) -> int:
    """How many processes of a session do not end by themselves; they are killed then."""
    end = time.monotonic() + PATIENCE_S
    while members(session) and time.monotonic() < end:
        time.sleep(LOOKS_S)
    remaining = members(session)
    for pid in remaining:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return len(remaining)
