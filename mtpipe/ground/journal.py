"""Results that are kept as they come, so that the same works, asked for again, go on from there.

A journal is a folder of its own. It keeps what each work gave in a file, whole or not at all, under
the number of the work and its name: whoever continues has to ask for the same works in the same
order, which what has the same content does.

Files are pickles, which can do anything as they are read: a journal is for the program that wrote
it and for nobody else's.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from mtpipe.ground.files import write_atomically

T = TypeVar("T")
P = ParamSpec("P")


class Kept(Executor):
    """An executor whose results are kept in a folder, and taken from there where they are."""

    def __init__(self, pool: Executor, folder: Path) -> None:
        self._pool, self._folder = pool, folder
        self._submitted = 0

    def submit(self, work: Callable[P, T], /, *args: P.args, **named: P.kwargs) -> Future[T]:
        """Have a work done, unless what it gives is there."""
        file = self._folder / f"{self._submitted:06d}-{work.__name__}.pickle"
        self._submitted += 1
        future: Future[T] = Future()
        if file.exists():
            future.set_result(pickle.loads(file.read_bytes()))
            return future

        def keep(done: Future[bytes]) -> None:
            try:
                packed = done.result()
                write_atomically(file, packed)
                future.set_result(pickle.loads(packed))
            except BaseException as error:  # for whoever waits, as an executor does it
                future.set_exception(error)

        self._pool.submit(packed, work, *args, **named).add_done_callback(keep)
        return future

    def there(self, works: int) -> int:
        """How many of the next `works` works are kept already."""
        numbers = range(self._submitted, self._submitted + works)
        return sum(any(self._folder.glob(f"{number:06d}-*.pickle")) for number in numbers)


def packed(work: Callable[..., Any], *args: Any, **named: Any) -> bytes:
    """Result of a work as bytes (pickle), made in the process that does the work."""
    return pickle.dumps(work(*args, **named), protocol=pickle.HIGHEST_PROTOCOL)
