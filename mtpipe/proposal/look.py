"""A file looked at: opened by the readers of `ingest`, and its columns' first values.

What the setup leaves open is tried: the decimal mark of text, and words that mean lost.
"""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.arrays import ArrayTable
from mtpipe.ingest.cells import is_no_number, is_number
from mtpipe.ingest.collect import OpenTable
from mtpipe.ingest.column_attributes import Stated
from mtpipe.ingest.data_files import open_stream
from mtpipe.ingest.instants import is_instant
from mtpipe.ingest.kinds import kind_of
from mtpipe.ingest.read import open_table
from mtpipe.ingest.text import TextTable
from mtpipe.ingest.text_layout import split_line
from mtpipe.setup.source_parts import Format, Layout

# Enough to see motion, and read in a second or two.
MOST_ROWS = 100_000
ROWS_OF_WORDS = 500
# What readers say of a file that is cut off and has whole rows.
TAKE_WHAT_IS_WHOLE = 'incomplete = "take"'
# A column of text has words in most rows, a bead that is sometimes lost in some.
WORDS_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Column:
    """A column's first values: float64, or datetime64[ns] of clock times; NaN for lost.

    `told` is how a setup tells it: by its name, or by its number from 1 where it has none.
    """

    told: str | int
    name: str
    values: NDArray[Any]
    stated: Stated

    @property
    def is_clock(self) -> bool:
        """Whether it holds clock times."""
        return self.values.dtype.kind == "M"

    @property
    def seconds(self) -> FloatArray:
        """Values as numbers; clock times in s since the first."""
        if not self.is_clock:
            values = np.asarray(self.values, dtype=np.float64)
            return np.where(np.isfinite(values), values, np.nan)
        passed = (self.values - self.values[0]).astype(np.int64) / 1e9
        return np.where(np.isnat(self.values), np.nan, passed)


@dataclass(frozen=True, eq=False)
class Look:
    """A file as it was found.

    Attributes
    ----------
    layout : keys of `[source]` without which it would not be read so.
    groups : columns with the same number of rows, the largest group first.
    rows : of the first group, as far as they were read.
    lost_tokens : words among numbers.
    alone : numbers that stand alone under a name.
    """

    path: Path
    kind: Format
    table: OpenTable
    layout: dict[str, Any]
    groups: tuple[tuple[Column, ...], ...]
    lost_tokens: tuple[str, ...] = ()
    alone: dict[str, float] = field(default_factory=dict)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the largest group."""
        return self.groups[0]

    @property
    def rows(self) -> int:
        """Rows of the largest group, as far as they were read."""
        return len(self.columns[0].values)

    @property
    def shape(self) -> tuple[str, ...]:
        """What files of one series have in common."""
        return tuple(str(column.told) for group in self.groups for column in group)


def look_at(path: Path) -> Look:
    """Open a file and read its first rows.

    Raises
    ------
    RecordingError : it is no table of numbers.
    """
    kind = kind_of(path)
    try:
        return _looked_at(path, kind, {})
    except RecordingError as error:
        if TAKE_WHAT_IS_WHOLE not in str(error):
            raise
    return _looked_at(path, kind, {"incomplete": "take"})


def _looked_at(path: Path, kind: Format, layout: dict[str, Any]) -> Look:
    tokens: tuple[str, ...] = ()
    if kind == "text":
        marks: list[dict[str, Any]] = [layout, {**layout, "decimal": ","}]
        found = [_numeric(path, one) for one in marks]
        # of equals the first
        layout, (usable, tokens) = max(
            zip(marks, found, strict=True), key=lambda one: len(one[1][0])
        )
        if not usable:
            raise RecordingError("holds no column of numbers", where=str(path))
    chosen = Layout.model_validate(layout)
    table = open_table(path, chosen, tokens)
    if isinstance(table, TextTable) and not table.has_names:
        table = open_table(path, chosen, tokens, _names_in_remark(table))
    if kind != "text":
        usable = list(range(len(table.names)))
    # of a file that is cut off all columns are one table, as far as all are whole
    apart = "incomplete" not in layout
    lengths = table.lengths if isinstance(table, ArrayTable) and apart else (0,) * len(table.names)
    # what has no name, or another's, is told by number
    once = Counter(table.names)
    named = {k for k, name in enumerate(table.names) if table.has_names and once[name] == 1}
    groups = []
    for length in dict.fromkeys(lengths[k] for k in usable):
        together = [k for k in usable if lengths[k] == length]
        values = first_values(table, together)
        groups.append(
            tuple(
                Column(
                    table.names[k] if k in named else k + 1,
                    table.names[k],
                    value,
                    table.stated[k],
                )
                for k, value in zip(together, values, strict=True)
            )
        )
    alone = {c.name: float(c.seconds[0]) for g in groups for c in g if len(c.values) == 1}
    groups = [group for group in groups if len(group[0].values) > 1]
    if not groups:
        raise RecordingError("holds no column of numbers", where=str(path))
    groups.sort(key=len, reverse=True)
    return Look(path, kind, table, layout, tuple(groups), tokens, alone)


def first_values(table: OpenTable, columns: Sequence[int]) -> list[NDArray[Any]]:
    """The first values of columns (positions from 0), at most `MOST_ROWS` of them."""
    pieces: list[list[NDArray[Any]]] = []
    rows = 0
    for batch in table.batches(columns):
        pieces.append(batch)
        rows += len(batch[0])
        if rows >= MOST_ROWS:
            break
    return [np.concatenate(column)[:MOST_ROWS] for column in zip(*pieces, strict=True)]


def _numeric(path: Path, layout: dict[str, Any]) -> tuple[list[int], tuple[str, ...]]:
    """Columns of numbers or clock times in a text, and the words among them that mean lost."""
    table = open_table(path, Layout.model_validate(layout))
    assert isinstance(table, TextTable)
    words: list[Counter[str]] = [Counter() for _ in table.names]
    filled = [0] * len(table.names)
    for _, line in islice(table.rows(), ROWS_OF_WORDS):
        for k, cell in enumerate(split_line(line, table.delimiter)[: len(table.names)]):
            if is_no_number(cell):
                continue
            filled[k] += 1
            if not is_number(cell, table.decimal) and not is_instant(cell):
                words[k][cell.strip()] += 1
    usable = [k for k, n in enumerate(filled) if words[k].total() <= WORDS_SHARE * n]
    # a number with another decimal mark is a fault of the file, and no word
    found = dict.fromkeys(word for k in usable for word in words[k])
    return usable, tuple(word for word in found if not any(c.isdigit() for c in word))


def _names_in_remark(table: TextTable) -> tuple[str, ...]:
    """Names of the columns in a remark before the numbers, as numpy.savetxt writes them."""
    with open_stream(table.path) as stream:
        text = io.TextIOWrapper(stream, encoding=table.encoding, errors="replace")
        lines = [line.strip() for line in islice(text, table.skip)]
    remarks = [line for line in lines if table.comment and line.startswith(table.comment)]
    for line in reversed(remarks):
        bare = line.removeprefix(table.comment).strip()
        for cells in (bare.split(), *(bare.split(mark) for mark in "\t;,")):
            words = [cell for cell in cells if not is_number(cell, table.decimal)]
            if len(cells) == len(table.names) and len(words) == len(cells):
                return tuple(cell.strip() for cell in cells)
    return ()
