"""A setup while it is proposed: its content, and for each key why it is what it is."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

USUAL = "usual value, not measured: change it"
NOT_KNOWN = "not known: estimated from the recording where that is possible"


@dataclass
class Draft:
    """Content of a setup by tables; `why` has a sentence for keys such as `beads.reference`.

    Sentences of keys in `guessed` are guesses that are told to the user. Keys in `fixed` were
    answered by the user and stay.
    """

    content: dict[str, Any] = field(default_factory=lambda: {"schema": 1})
    why: dict[str, str] = field(default_factory=dict)
    guessed: list[str] = field(default_factory=list)
    fixed: set[str] = field(default_factory=set)

    def put(self, key: str, value: Any, why: str = "", *, guess: bool = False) -> None:
        """Set a key, told by its path; an earlier value of it is replaced unless it is fixed."""
        if self.is_fixed(key):
            return
        if isinstance(value, Mapping) and value:
            for name, one in value.items():
                self.put(f"{key}.{name}", one)
        else:
            table = self.content
            *path, last = key.split(".")
            for part in path:
                table = table.setdefault(part, {})
            table[last] = value
        self.why[key] = why
        if key in self.guessed:
            self.guessed.remove(key)
        if guess:
            self.guessed.append(key)

    def is_fixed(self, key: str) -> bool:
        """Whether the user stated a key, or the table that it is in."""
        return any(key == one or key.startswith(f"{one}.") for one in self.fixed)

    def states_some(self, key: str) -> bool:
        """Whether the user stated a key, or one within it."""
        return self.is_fixed(key) or any(one.startswith(f"{key}.") for one in self.fixed)

    def get(self, key: str) -> Any:
        """Value of a key; None where it is not set."""
        value: Any = self.content
        for part in key.split("."):
            if not isinstance(value, Mapping) or part not in value:
                return None
            value = value[part]
        return value

    def drop(self, key: str) -> None:
        """Take a key away, if it is there."""
        table: Any = self.content
        *path, last = key.split(".")
        for part in path:
            table = table.get(part, {})
        table.pop(last, None)
        self.why.pop(key, None)
        if key in self.guessed:
            self.guessed.remove(key)

    def fix(self, parts: Mapping[str, Any], why: str = "", prefix: str = "") -> None:
        """Put what the user states, a part of a setup, for good."""
        for key, value in parts.items():
            path = f"{prefix}{key}"
            if isinstance(value, Mapping):
                self.fix(value, why, f"{path}.")
            else:
                self.fixed.discard(path)
                self.put(path, value, why)
                self.fixed.add(path)

    def copied(self) -> Draft:
        """A draft of its own."""
        return Draft(
            copy.deepcopy(self.content), dict(self.why), list(self.guessed), set(self.fixed)
        )
