"""Inputs of readers: what a case is, and how input number i of a reader comes about.

Everything about an input follows from the reader's name and the number: `--only READER --input i`
makes it again.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from damage import damaged

Random = np.random.Generator
# Shares of inputs that are written by a grammar, if the reader has one, and that are damaged bytes
# of a sound file; the others are sound files of another structure.
GRAMMAR, BYTES = 0.3, 0.65
# Share of files of another structure whose bytes are damaged as well.
BOTH = 0.15


@dataclass(frozen=True)
class Case:
    """Files of one input.

    Attributes
    ----------
    target : the file that is read, or "." for the folder.
    setup : what the setup says of it.
    options : `take`, whether a file that is cut off is read as far as it is whole.
    """

    files: Mapping[str, bytes]
    target: str
    setup: Any = None
    options: Mapping[str, bool] = field(default_factory=lambda: {"take": False})

    def with_content(self, content: bytes, name: str | None = None) -> Case:
        """The same with another content of one file, by default of the target."""
        return replace(self, files={**self.files, name or self.target: content})

    def write(self, folder: Path) -> Path:
        """Write all files; the path of the target."""
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        return folder / self.target


Step = Callable[[], object]


@dataclass(frozen=True)
class Reader:
    """A reader of mtpipe under test.

    Attributes
    ----------
    seeds : sound inputs of each layout.
    odd : an input of another structure.
    steps : what is read of an input that stands in a folder; each step is judged by itself.
    grammar : inputs by a grammar, by number; None where there is no text.
    """

    name: str
    seeds: Callable[[], Sequence[Case]]
    odd: Callable[[Random], Case]
    steps: Callable[[Path, Case], Iterator[Step]]
    grammar: Callable[[int], Case] | None = None


def case_of(reader: Reader, number: int) -> Case:
    """Input `number` of a reader; every other one is read as far as it is whole."""
    return replace(_case(reader, number), options={"take": number % 2 == 1})


def _case(reader: Reader, number: int) -> Case:
    random = np.random.default_rng([zlib.crc32(reader.name.encode()), number])
    way = random.random()
    if reader.grammar is not None:
        if way < GRAMMAR:
            return reader.grammar(number)
        way = (way - GRAMMAR) / (1 - GRAMMAR)
    if way < BYTES:
        seeds = reader.seeds()
        return _damaged(seeds[random.integers(len(seeds))], random)
    case = reader.odd(random)
    return _damaged(case, random) if random.random() < BOTH else case


def _damaged(case: Case, random: Random) -> Case:
    """The case with one file damaged: the target, or any where it is one of many that are read."""
    names = list(case.files)
    name = names[random.integers(len(names))]
    return case.with_content(damaged(case.files[name], random), name)
