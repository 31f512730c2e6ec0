"""Work spread over processes where there is something to spread, else done at once.

Either way its linear algebra is done in one thread. Matrices are small here: threads that wait for
one another take more processor time, and longer.

Workers end with the process that started them, however it ends. One that is ended from outside, as
by a system that has no memory left, is told as that.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from types import TracebackType
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.script_guard import check_guard

T = TypeVar("T")
P = ParamSpec("P")


def executor(workers: int) -> Executor:
    """Processes where there are several workers, else this one.

    Raises
    ------
    MtpipeError : the script that asks for them has no guard; or, on leaving, one has been ended
        from outside.
    """
    if workers <= 1:
        return _InThisProcess()
    check_guard(workers)
    # spawned, not forked: threads of the numerical libraries do not survive a fork
    context = multiprocessing.get_context("spawn")
    return _Processes(workers, mp_context=context, initializer=_belong_to_the_first)


def in_one_thread(work: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> T:
    """Do a work, its linear algebra in this thread alone."""
    with threadpool_limits(limits=1, user_api="blas"):
        return work(*args, **named)


def _belong_to_the_first() -> None:
    """Leave Ctrl-C and the end of a terminal to the process that was called, and end with it."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):  # Windows has no SIGHUP
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    threading.Thread(target=_end_with_the_first, daemon=True).start()


def _end_with_the_first() -> None:
    first = multiprocessing.parent_process()
    if first is not None:
        first.join()
        os._exit(1)


class _Processes(ProcessPoolExecutor):
    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        super().__exit__(kind, error, trace)
        if isinstance(error, BrokenProcessPool):
            raise MtpipeError(
                "a worker process was ended from outside, most likely by a system that has no "
                "memory left",
                mend="Use fewer workers (--workers 1 needs least), or more memory.",
            ) from None

    def submit(self, work: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> Future[T]:
        return super().submit(in_one_thread, work, *args, **named)


class _InThisProcess(Executor):
    """Does at once what is submitted."""

    def submit(self, work: Callable[..., T], /, *args: Any, **named: Any) -> Future[T]:
        future: Future[T] = Future()
        future.set_result(in_one_thread(work, *args, **named))
        return future
