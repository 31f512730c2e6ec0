"""Works in steps: between them they wait for what others do, and meanwhile another may go on.

A work is a generator that yields the futures it waits for and returns its result. All of them take
turns in one thread, so nothing they touch has to stand two at a time.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, TypeVar

T = TypeVar("T")
K = TypeVar("K")
Steps = Generator[Sequence[Future[Any]], None, T]


def finished(steps: Steps[T]) -> T:
    """The result of one work, waiting wherever it waits."""
    while True:
        try:
            wait(next(steps))
        except StopIteration as end:
            result: T = end.value
            return result


def side_by_side(
    works: Iterable[tuple[K, Steps[T]]], at_once: int
) -> Iterator[tuple[K, T | Exception]]:
    """Results of many works as they end, by name; of one that fails its exception.

    Parameters
    ----------
    at_once : another work is begun where those that are under way wait for fewer futures.
    """
    coming, under_way = iter(works), dict[int, tuple[K, Steps[T], Sequence[Future[Any]]]]()
    begun, more = 0, True
    while more or under_way:
        waited = [one for _, _, some in under_way.values() for one in some if not one.done()]
        able = [number for number, (_, _, some) in under_way.items() if all(f.done() for f in some)]
        if not able and more and len(waited) < at_once:
            another = next(coming, None)
            more = another is not None
            if another is None:
                continue
            under_way[begun], able = (*another, ()), [begun]
            begun += 1
        if not able:
            wait(waited, return_when=FIRST_COMPLETED)
        for number in able:
            name, steps, _ = under_way.pop(number)
            try:
                under_way[number] = name, steps, next(steps)
            except StopIteration as end:
                yield name, end.value
            except Exception as error:
                yield name, error
