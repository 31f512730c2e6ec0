"""Work spread over processes where there is something to spread, else done at once."""

from __future__ import annotations

import signal
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, TypeVar

T = TypeVar("T")


def executor(workers: int) -> Executor:
    """Processes where there are several workers, else this one."""
    if workers <= 1:
        return _InThisProcess()
    # spawned, not forked: threads of the numerical libraries do not survive a fork
    return ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=_leave_interrupts_to_the_first
    )


def _leave_interrupts_to_the_first() -> None:
    """Ctrl-C reaches every process of a terminal; the one that was called answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class _InThisProcess(Executor):
    """Does at once what is submitted."""

    def submit(self, work: Callable[..., T], /, *args: Any, **named: Any) -> Future[T]:
        future: Future[T] = Future()
        future.set_result(work(*args, **named))
        return future
