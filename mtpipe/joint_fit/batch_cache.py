"""A cache of the latest results, as `functools.lru_cache`, for results computed many at a time."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


class BatchCache(Generic[Key, Value]):
    """Values by key, a limited number: the least recently used one is dropped first."""

    def __init__(self, most: int) -> None:
        self.most = most
        self._known: OrderedDict[Key, Value] = OrderedDict()

    def get(self, key: Key) -> Value | None:
        """The value; None where it is not known any more."""
        found = self._known.get(key)
        if found is not None:
            self._known.move_to_end(key)
        return found

    def put(self, key: Key, value: Value) -> None:
        """Keep a value."""
        self._known[key] = value
        self._known.move_to_end(key)
        if len(self._known) > self.most:
            self._known.popitem(last=False)
