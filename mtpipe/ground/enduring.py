"""Processes that may be ended from outside, as by a system without memory: works are done again.

One process that ends takes the works of all others with it. Those are tried once more, one after
the other, so that the next end tells which work brings it about. That one is given up, and the
others go on side by side.
"""

from __future__ import annotations

import multiprocessing
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import Any, ParamSpec, TypeVar

from mtpipe.ground.processes import (
    Hear,
    Processes,
    Workers,
    ended_from_outside,
    executor,
    why_no_process_starts,
)
from mtpipe.ground.script_guard import check_guard

T = TypeVar("T")
P = ParamSpec("P")


def enduring_executor(workers: Workers, *, hear: Hear) -> AbstractContextManager[Executor]:
    """As `executor`; several processes go on where one of them is ended.

    Raises
    ------
    MtpipeError : as `executor`; of a work, as its error: processes that did it were ended, twice.
    """
    if isinstance(workers, Executor) or workers <= 1 or why_no_process_starts():
        return executor(workers, hear=hear)
    check_guard(workers)
    return _Enduring(workers, hear)


@dataclass(eq=False)
class _Work:
    future: Future[Any]
    call: Callable[[Processes], Future[Any]]
    alone: bool = False


class _Enduring(Executor):
    def __init__(self, workers: int, hear: Hear) -> None:
        self._workers, self._hear = workers, hear
        self._lock = threading.RLock()
        self._pool: Processes | None = None
        self._waiting: deque[_Work] = deque()
        self._suspected: deque[_Work] = deque()
        self._running: set[_Work] = set()
        self._closed = False

    def submit(self, work: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> Future[T]:
        """Have a work done by one of the processes."""
        future: Future[T] = Future()
        one = _Work(future, lambda pool: pool.submit(work, *args, **named))
        with self._lock:
            self._waiting.append(one)
            self._fill()
        return future

    def _fill(self) -> None:
        """Give the processes as much as they can do."""
        while not self._closed:
            queue = self._suspected or self._waiting
            most = (
                1 if self._suspected or any(one.alone for one in self._running) else self._workers
            )
            if not queue or len(self._running) >= most:
                return
            if self._pool is None:
                self._pool = Processes(self._workers, self._hear)
            one = queue[0]
            try:
                done = one.call(self._pool)
            except BrokenProcessPool:  # a process was ended that had nothing to do
                self._pool = None
                continue
            queue.popleft()
            one.alone = queue is self._suspected
            self._running.add(one)
            done.add_done_callback(partial(self._done, one))

    def _done(self, one: _Work, done: Future[Any]) -> None:
        if done.cancelled():
            one.future.cancel()
            return
        error = done.exception()
        broken = isinstance(error, BrokenProcessPool)
        with self._lock:
            self._running.discard(one)
            again = broken and not one.alone and not self._closed
            if again:
                self._suspected.append(one)
            if broken and not self._running:
                self._pool = None
            if not (broken and self._running):  # else the others end at once, for the same reason
                self._fill()
        if again:
            return
        if error is None:
            one.future.set_result(done.result())
        else:
            one.future.set_exception(ended_from_outside() if broken else error)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._lock:
            self._closed, pool = True, self._pool
        if kind is not None:
            for child in multiprocessing.active_children():
                child.terminate()
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)
