"""Work spread over processes where there is something to spread, else done at once.

Whoever spreads work takes an `Executor` and knows no more of it: these processes, this one alone,
or a cluster (`ground.cluster`). A work may spread its parts in turn (`with_parts`, `in_order`), and
tell what it is at (`tell`).

Either way its linear algebra is done in one thread. Matrices are small here: threads that wait for
one another take more processor time, and longer.

Where the system lets no process be started, all is done in this one.

Workers end with the process that started them, however it ends. One that is ended from outside, as
by a system that has no memory left, is told as that.
"""

from __future__ import annotations

import functools
import multiprocessing
import os
import pickle
import signal
import threading
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from multiprocessing import spawn
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Generic, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

from mtpipe.ground.errors import WorkerEndedError
from mtpipe.ground.script_guard import check_guard

T = TypeVar("T")
P = ParamSpec("P")
# Who does the work: a number of processes, or an executor that the caller has made.
Workers = int | Executor
Hear = Callable[[str], None]

# Of the work that this process is doing: where its parts are done, whether they may be elsewhere,
# and who hears what it tells.
_parts: Executor | None = None
_divided = True
_hear: Hear | None = None


def executor(
    workers: Workers, *, most: int | None = None, hear: Hear | None = None
) -> AbstractContextManager[Executor]:
    """Processes where there are several workers, else this one; an executor stays what it is.

    Parameters
    ----------
    most : number of processes that have something to do; more are not started.
    hear : is given what works `tell`.

    Raises
    ------
    MtpipeError : the script that asks for them has no guard; or, on leaving, one has been ended
        from outside.
    """
    if isinstance(workers, Executor):
        return nullcontext(workers)
    if min(workers, workers if most is None else most) <= 1:
        return _InThisProcess(hear)
    hindrance = why_no_process_starts()
    if hindrance:
        if hear is not None:
            hear(f"no worker can be started here, {hindrance}: this process does all")
        return _InThisProcess(hear)
    check_guard(workers)
    return Processes(workers if most is None else min(workers, most), hear)


@functools.cache
def why_no_process_starts() -> str:
    """What hinders this program from starting others, in words; empty where nothing does.

    Containers without shared memory have no locks; a service may not be allowed to run the
    interpreter that an administrator's environment points to.
    """
    if not os.access(spawn.get_executable(), os.X_OK):
        return "as the Python interpreter may not be run again"
    try:
        multiprocessing.get_context("spawn").Lock()
    except OSError as error:
        return f"as there are no locks between processes ({error.strerror})"
    return ""


def tell(what: str) -> None:
    """Say what the work is at that this process is doing, to whoever wants to hear it."""
    if _hear is not None:
        _hear(what)


@contextmanager
def heard_by(hear: Hear | None) -> Iterator[None]:
    """Let somebody hear what works tell."""
    global _hear
    before, _hear = _hear, hear
    try:
        yield
    finally:
        _hear = before


@contextmanager
def undivided() -> Iterator[None]:
    """Let works in this process do their parts here, however many processes they are allowed."""
    global _divided
    before, _divided = _divided, False
    try:
        yield
    finally:
        _divided = before


def with_parts(workers: int, work: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> T:
    """Do a work whose parts may be spread over `workers` processes, this one included."""
    global _parts
    if workers <= 1 or not _divided or why_no_process_starts():
        return work(*args, **named)
    _parts = Processes(workers - 1, None)
    try:
        return work(*args, **named)
    finally:
        _parts.shutdown()
        _parts = None


def in_order(part: Callable[..., T], arguments: Iterable[tuple[Any, ...]]) -> Iterator[T]:
    """Results of the parts of a work, in the order of their arguments.

    Arguments are made one after the other, here, while earlier parts are done elsewhere.
    """
    if _parts is None:
        yield from (part(*some) for some in arguments)
        return
    ahead: deque[Future[T]] = deque()
    try:
        for some in arguments:
            ahead.append(_parts.submit(part, *some))
            if len(ahead) > AHEAD:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    finally:
        for one in ahead:
            one.cancel()


def in_one_thread(work: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> T:
    """Do a work, its linear algebra in this thread alone."""
    with threadpool_limits(limits=1, user_api="blas"):
        return work(*args, **named)


class Sent(Generic[T]):
    """A value that the parts of a work share: it is packed once, and unpacked once where it goes.

    Parts that are done in this process take the value itself.
    """

    def __init__(self, value: T) -> None:
        self._value: T | None = value
        self._packed: tuple[str, bytes] | None = None

    def __getstate__(self) -> tuple[str, bytes]:
        if self._packed is None:
            self._packed = uuid.uuid4().hex, pickle.dumps(self._value)
        return self._packed

    def __setstate__(self, packed: tuple[str, bytes]) -> None:
        self._value, self._packed = None, packed

    def value(self) -> T:
        """The value."""
        if self._value is not None:
            return self._value
        assert self._packed is not None
        name, content = self._packed
        if name not in _unpacked:
            _unpacked.clear()  # what was sent before is of a work that has ended
            _unpacked[name] = pickle.loads(content)
        found: T = _unpacked[name]
        return found


_unpacked: dict[str, Any] = {}
# Parts submitted ahead of the one whose result is taken: enough to keep all processes busy, few
# enough for the memory.
AHEAD = 8
# Longest progress message in bytes: a pipe takes it at once, and it fits a line of a terminal.
LONGEST = 500


def _belong_to_the_first(telling: Connection | None) -> None:
    """Leave Ctrl-C and the end of a terminal to the process that was called, and end with it."""
    global _hear
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):  # Windows has no SIGHUP
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    threading.Thread(target=_end_with_the_first, daemon=True).start()
    # no lock, which a process that is killed would keep: short messages are written at once
    _hear = None if telling is None else lambda what: telling.send_bytes(what.encode()[:LONGEST])


def _end_with_the_first() -> None:
    first = multiprocessing.parent_process()
    if first is not None:
        first.join()
        os._exit(1)


def ended_from_outside() -> WorkerEndedError:
    """What is to be told of a work whose process was ended."""
    return WorkerEndedError(
        "a worker process was ended from outside, most likely by a system that has no memory left",
        mend="Use fewer workers (--workers 1 needs least), or more memory.",
    )


class Processes(ProcessPoolExecutor):
    """Pool of processes of this program."""

    def __init__(self, workers: int, hear: Hear | None) -> None:
        # spawned, not forked: threads of the numerical libraries do not survive a fork
        context = multiprocessing.get_context("spawn")
        hearing, telling = context.Pipe(duplex=False)
        self._telling = telling
        super().__init__(
            workers,
            mp_context=context,
            initializer=_belong_to_the_first,
            initargs=(None if hear is None else telling,),
        )
        threading.Thread(target=_listen, args=(hearing, hear), daemon=True).start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        super().__exit__(kind, error, trace)
        self._telling.close()
        if isinstance(error, BrokenProcessPool):
            raise ended_from_outside() from None

    def submit(self, work: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> Future[T]:
        """Have a work done by one of them, its linear algebra in one thread."""
        future = super().submit(in_one_thread, work, *args, **named)
        # The pool lists the workers that it watches before it starts the one for this work: unless
        # it looks again, the end of that one is noticed only when another has a result.
        with self._shutdown_lock:
            if self._executor_manager_thread_wakeup is not None:
                self._executor_manager_thread_wakeup.wakeup()
        return future


def _listen(hearing: Connection, hear: Hear | None) -> None:
    with hearing, suppress(EOFError):  # once nobody is left who could tell
        while True:
            told = hearing.recv_bytes().decode(errors="replace")
            if hear is not None:
                hear(told)


class _InThisProcess(Executor):
    """Does at once what is submitted."""

    def __init__(self, hear: Hear | None) -> None:
        self._hear = hear

    def submit(self, work: Callable[..., T], /, *args: Any, **named: Any) -> Future[T]:
        future: Future[T] = Future()
        try:
            with heard_by(self._hear):
                future.set_result(in_one_thread(work, *args, **named))
        except Exception as error:
            future.set_exception(error)
        return future
