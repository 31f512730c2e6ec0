"""Work spread over processes where there is something to spread, else done at once.

Either way its linear algebra is done in one thread. Matrices are small here: threads that wait for
one another take more processor time, and longer.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

T = TypeVar("T")
P = ParamSpec("P")


def executor(workers: int) -> Executor:
    """Processes where there are several workers, else this one."""
    if workers <= 1:
        return _InThisProcess()
    # spawned, not forked: threads of the numerical libraries do not survive a fork
    return _Processes(
        workers, mp_context=get_context("spawn"), initializer=_leave_interrupts_to_the_first
    )


def in_one_thread(work: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> T:
    """Do a work, its linear algebra in this thread alone."""
    with threadpool_limits(limits=1, user_api="blas"):
        return work(*args, **named)


def _leave_interrupts_to_the_first() -> None:
    """Ctrl-C reaches every process of a terminal; the one that was called answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class _Processes(ProcessPoolExecutor):
    def submit(self, work: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> Future[T]:
        return super().submit(in_one_thread, work, *args, **named)


class _InThisProcess(Executor):
    """Does at once what is submitted."""

    def submit(self, work: Callable[..., T], /, *args: Any, **named: Any) -> Future[T]:
        future: Future[T] = Future()
        future.set_result(in_one_thread(work, *args, **named))
        return future
