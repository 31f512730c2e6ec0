"""Progress of long work: to whoever asked for it, else a bar in a notebook, else nowhere."""

from __future__ import annotations

import html
import importlib
import sys
from dataclasses import dataclass
from typing import Any

from mtpipe.ground.types import NamedProgress, Progress


@dataclass(frozen=True)
class Bar:
    """How far a step is, as text and for a notebook."""

    step: str
    done: int
    total: int

    def __repr__(self) -> str:
        return f"{self.step}: {self.done} of {self.total}"

    def _repr_html_(self) -> str:
        return (
            f'<progress value="{self.done}" max="{max(self.total, 1)}"></progress> '
            f"{html.escape(repr(self))}"
        )


def by_name(progress: NamedProgress | None) -> NamedProgress:
    """The callback given, or a bar in the notebook that runs, or one that says nothing."""
    if progress is not None:
        return progress
    show = _notebook_display()
    if show is None:
        return lambda step, done, total: None
    handles: list[Any] = []

    def advance(step: str, done: int, total: int) -> None:
        bar = Bar(step, done, total)
        if handles:
            handles[0].update(bar)
        else:
            handles.append(show(bar, display_id=True))

    return advance


def of_step(progress: Progress | None, step: str) -> Progress:
    """The same for work of one step, which the bar names."""
    if progress is not None:
        return progress
    say = by_name(None)
    return lambda done, total: say(step, done, total)


def _notebook_display() -> Any:
    """IPython's `display` within a notebook's kernel; None anywhere else, its terminal included."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if getattr(shell, "kernel", None) is None:
        return None
    return importlib.import_module("IPython.display").display
