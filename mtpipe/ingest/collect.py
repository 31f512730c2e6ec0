"""Filling a recording's arrays from batches of columns.

Every number is written once, into its place: no table of the whole file ever exists beside the
arrays. Arrays grow by doubling; memory that is not yet written costs nothing. Which rows are
left out, and what means lost, is decided here batch by batch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.announced import check_fits
from mtpipe.ingest.column_attributes import Stated
from mtpipe.ingest.columns import Assignment
from mtpipe.ingest.instants import since
from mtpipe.setup.source_parts import Rows
from mtpipe.setup.source_signals import Lost

FIRST_ROWS = 1 << 16
FARTHEST_NM = 1e12  # a kilometre: what is beyond is as good as infinite
FARTHEST_MM = 1e6


class OpenTable(Protocol):
    """A file seen as a table of columns: `TextTable`, `ParquetTable`, `ArrayTable`.

    `names` of the columns, or their numbers where the file has none; `stated` is what the file
    says of each; `unusable` what else is in it, and why it is no column; `guesses` are sentences
    on what the setup left open, `remarks` on what was met while reading. `batches` yields the
    wanted columns (positions from 0) piecewise, as float64 or, of clock times, datetime64[ns].
    """

    @property
    def path(self) -> Path: ...  # noqa: D102
    @property
    def names(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def has_names(self) -> bool: ...  # noqa: D102
    @property
    def guesses(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def stated(self) -> tuple[Stated, ...]: ...  # noqa: D102
    @property
    def unusable(self) -> Mapping[str, str]: ...  # noqa: D102
    @property
    def remarks(self) -> list[str]: ...  # noqa: D102
    def batches(self, wanted: Sequence[int]) -> Iterator[list[NDArray[Any]]]: ...  # noqa: D102


@dataclass(frozen=True)
class Collected:
    """What stands in the files, in nm, s, mm and turns; None for what they do not have.

    Attributes
    ----------
    positions_nm : (n_rows, 3) for each bead.
    time_s, frame, magnet_mm, turns : (n_rows,) or None.
    began : the clock time from which `time_s` counts; None where it counts as the file does.
    starts : first row (from 0) of each file.
    zero_rows : rows whose positions were all 0 and were taken as lost.
    infinite : number of infinite positions by bead, now NaN.
    unused : columns of a canonical file that mean nothing here.
    """

    positions_nm: dict[str, FloatArray]
    time_s: FloatArray | None
    frame: FloatArray | None
    magnet_mm: FloatArray | None
    turns: FloatArray | None
    starts: tuple[int, ...]
    zero_rows: int
    infinite: dict[str, int]
    unused: tuple[str, ...]
    began: np.datetime64 | None = None


@dataclass(frozen=True)
class RowChoice:
    """Rows kept and left out, counted from 1 through all files, both ends included."""

    keep: tuple[Rows, ...] = ()
    skip: tuple[Rows, ...] = ()

    def mask(self, first: int, count: int) -> NDArray[np.bool_] | None:
        """Which of `count` rows from row `first` (from 0) are kept; None for all of them."""
        if not self.keep and not self.skip:
            return None
        kept = np.full(count, not self.keep)
        for wanted, ranges in ((True, self.keep), (False, self.skip)):
            for a, b in ranges:
                kept[max(0, a - 1 - first) : max(0, b - first)] = wanted
        return kept

    def position(self, row: int) -> int:
        """Where a row of the files (from 1) stands among the rows kept (from 0)."""
        mask = self.mask(0, row - 1)
        return row - 1 if mask is None else int(np.count_nonzero(mask))


def collect(
    tables: Sequence[OpenTable],
    assign: Callable[[OpenTable], Assignment],
    lost: Lost,
    rows: RowChoice,
) -> Collected:
    """Read files one after another into one set of arrays.

    Parameters
    ----------
    tables : the files in order; all must have the same columns.
    assign : says which column is what.

    Raises
    ------
    RecordingError : files that differ in their beads, a damaged file, or no row at all.
    """
    arrays: _Arrays | None = None
    seen = 0
    starts = []
    for table in tables:
        plan = assign(table)
        if arrays is None:
            arrays = _Arrays(plan, lost, table)
        arrays.begin(plan, table)
        starts.append(arrays.filled)
        for batch in table.batches(arrays.wanted):
            count = len(batch[0])
            mask = rows.mask(seen, count)
            arrays.add(batch if mask is None else [c[mask] for c in batch])
            seen += count
    if arrays is None or arrays.filled == 0:
        where = str(tables[0].path) if tables else None
        what = "has no rows" if seen == 0 else f"none of its {seen} rows is kept"
        raise RecordingError(what, where=where)
    return arrays.result(tuple(starts))


class _Arrays:
    """The arrays while they are filled."""

    def __init__(self, plan: Assignment, lost: Lost, table: OpenTable) -> None:
        self.plan = plan
        self.table = table
        self.lost = lost
        self.filled = 0
        self.zero_rows = 0
        self.infinite = dict.fromkeys(plan.beads, 0)
        self.began: np.datetime64 | None = None
        self.last_s = 0.0
        self.scalars = [c for c in (plan.time, plan.frame, plan.magnet, plan.rotation) if c >= 0]
        self.places = [
            (bead, axis, column)
            for bead, columns in plan.beads.items()
            for axis, column in enumerate(columns)
        ]
        self.wanted = self.scalars + [c for _, _, c in self.places if c >= 0]
        self.values = {column: np.empty(FIRST_ROWS) for column in self.scalars}
        self.positions = {bead: np.empty((FIRST_ROWS, 3)) for bead in plan.beads}

    def begin(self, plan: Assignment, table: OpenTable) -> None:
        """Begin the next file, which must have the columns of those before it."""
        self.table, path = table, table.path
        if list(plan.beads) != list(self.plan.beads):
            raise RecordingError(
                f"has beads {', '.join(plan.beads)} where the files before it have "
                f"{', '.join(self.plan.beads)}",
                where=str(path),
            )
        if plan != self.plan:
            raise RecordingError("has other columns than the files before it", where=str(path))

    def add(self, batch: list[NDArray[Any]]) -> None:
        start, stop = self.filled, self.filled + len(batch[0])
        self._make_room(stop)
        columns = {
            column: self._seconds(column, values) if values.dtype.kind == "M" else values
            for column, values in zip(self.wanted, batch, strict=True)
        }
        for column in self.scalars:
            self.values[column][start:stop] = columns[column]
        for bead, axis, column in self.places:
            target = self.positions[bead][start:stop, axis]
            if column < 0:
                target[:] = np.nan
                continue
            with np.errstate(over="ignore", invalid="ignore"):
                np.multiply(columns[column], self.plan.factors[axis], out=target)
            for value in self.lost.values:
                target[columns[column] == value] = np.nan
            infinite = np.abs(target) > FARTHEST_NM
            if infinite.any():
                self.infinite[bead] += int(np.count_nonzero(infinite))
                target[infinite] = np.nan
        if self.lost.all_zero_rows:
            zero = np.logical_and.reduce([columns[c] == 0 for _, _, c in self.places if c >= 0])
            if zero.any():
                self.zero_rows += int(np.count_nonzero(zero))
                for xyz in self.positions.values():
                    xyz[start:stop][zero] = np.nan
                for column in (self.plan.magnet, self.plan.rotation):
                    if column >= 0:
                        self.values[column][start:stop][zero] = np.nan
        self.filled = stop

    def _seconds(self, column: int, moments: NDArray[Any]) -> FloatArray:
        """Clock times as seconds since the first of the recording."""
        if column != self.plan.time:
            raise RecordingError(
                f"column {self.table.names[column]} holds clock times where numbers are expected",
                where=str(self.table.path),
                mend="Correct the columns in [source]; only time can be a clock time.",
            )
        if self.began is None:
            known = moments[~np.isnat(moments)]
            self.began = known[0] if len(known) else None
        passed = since(self.began, moments, self.last_s)
        self.last_s = np.nanmax(passed, initial=self.last_s)
        return passed

    def result(self, starts: tuple[int, ...]) -> Collected:
        n, plan = self.filled, self.plan

        def scalar(column: int, factor: float, offset: float = 0.0) -> FloatArray | None:
            if column < 0:
                return None
            values = self.values[column][:n]
            if factor != 1.0:
                values *= factor
            return values + offset if offset else values

        def bounded(values: FloatArray | None) -> FloatArray | None:
            if values is not None:
                values[~(np.abs(values) < FARTHEST_MM)] = np.nan
            return values

        return Collected(
            positions_nm={bead: xyz[:n] for bead, xyz in self.positions.items()},
            time_s=scalar(plan.time, plan.time_s if self.began is None else 1.0),
            frame=scalar(plan.frame, 1.0),
            magnet_mm=bounded(scalar(plan.magnet, plan.magnet_mm, plan.magnet_offset_mm)),
            turns=bounded(scalar(plan.rotation, plan.turns)),
            starts=starts,
            zero_rows=self.zero_rows,
            infinite={bead: count for bead, count in self.infinite.items() if count},
            unused=plan.unused,
            began=self.began,
        )

    def _make_room(self, rows: int) -> None:
        columns = len(self.values) + sum(xyz.shape[1] for xyz in self.positions.values())
        check_fits(rows * columns, str(self.table.path))
        for column, values in self.values.items():
            self.values[column] = _grown(values, self.filled, rows)
        for bead, xyz in self.positions.items():
            self.positions[bead] = _grown(xyz, self.filled, rows)


def _grown(array: FloatArray, filled: int, rows: int) -> FloatArray:
    """An array with room for `rows` rows, holding the `filled` rows there are."""
    if len(array) >= rows:
        return array
    larger = np.empty((max(rows, 2 * len(array)), *array.shape[1:]))
    larger[:filled] = array[:filled]
    return larger
