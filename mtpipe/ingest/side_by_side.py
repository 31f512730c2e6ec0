"""Files that hold one bead each: read beside one another, as one table.

`[source] beads = { name = "{name}", x = …, y = …, z = … }` says so: `{name}` is the name of the
file without its suffix. Time, frame number and magnet are those of the first file; the clocks of
the others have to agree with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.collect import OpenTable
from mtpipe.ingest.column_attributes import Stated
from mtpipe.ingest.columns import Names
from mtpipe.setup.source_parts import NAME, BeadColumns
from mtpipe.setup.source_table import Source


@dataclass(frozen=True)
class SideBySide:
    """Files of the same rows seen as one table; attributes as in `collect.OpenTable`.

    Columns are called `file/column`. `clocks` are the columns, one of each file, that have to be
    alike.
    """

    path: Path
    tables: tuple[OpenTable, ...]
    names: tuple[str, ...]
    stated: tuple[Stated, ...]
    clocks: tuple[int, ...] = ()
    has_names: bool = True
    guesses: tuple[str, ...] = ()
    unusable: Mapping[str, str] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list, compare=False)

    def batches(self, wanted: Sequence[int]) -> Iterator[list[NDArray[Any]]]:
        """Yield the wanted columns (positions from 0) at once, (n_rows,) each.

        Raises
        ------
        RecordingError : files that differ in their rows or clocks, or as of the single files.
        """
        found: dict[int, NDArray[Any]] = {}
        rows: dict[str, int] = {}
        first = 0
        for table in self.tables:
            mine = range(first, first + len(table.names))
            asked = sorted({k for k in (*wanted, *self.clocks) if k in mine})
            first += len(table.names)
            if not asked:
                continue
            pieces = list(table.batches([k - mine.start for k in asked]))
            columns = [np.concatenate(column) for column in zip(*pieces, strict=True)]
            found |= dict(zip(asked, columns, strict=True))
            rows[table.path.name] = len(columns[0])
            self.remarks.extend(r for r in table.remarks if r not in self.remarks)
        if len(set(rows.values())) > 1:
            told = ", ".join(f"{name}: {n}" for name, n in rows.items())
            raise RecordingError(
                f"files of one bead each have to have the same rows; they have {told[:300]}",
                where=str(self.path),
                mend="Leave out files of other recordings ([source] files).",
            )
        # without any clock, what is known is that the files have the same number of rows
        others = self.tables[1:] if self.clocks else ()
        for clock, table in zip(self.clocks[1:], others, strict=True):
            if not np.array_equal(found[clock], found[self.clocks[0]]):
                raise RecordingError(
                    f"has other times than {self.tables[0].path.name}, and files of one bead each "
                    "have to be of one recording",
                    where=str(table.path),
                )
        yield [found[k] for k in wanted]


def is_file_per_bead(source: Source | None) -> bool:
    """Whether the setup says that each file holds one bead."""
    return source is not None and any(NAME in (bead.name or "") for bead in source.beads)


def side_by_side(
    tables: Sequence[OpenTable], source: Source, folder: Path
) -> tuple[SideBySide, Source]:
    """One table of all files, and `[source]` with the beads by the names of the files.

    Raises
    ------
    RecordingError : two files have the same name, or one lacks a column.
    """
    stems = [Path(table.path.name.removesuffix(".gz")).stem for table in tables]
    twice = [stem for stem in stems if stems.count(stem) > 1]
    if twice:
        raise RecordingError(f"two files are called {twice[0]!r}", where=str(folder))
    places = [
        Names(table.names, table.has_names, str(table.path), table.unusable) for table in tables
    ]
    starts = np.cumsum([0, *(len(table.names) for table in tables)]).tolist()

    def place(column: int | str, what: str, k: int = 0) -> int:
        return int(starts[k]) + places[k].find(column, what) + 1

    beads = []
    for entry in source.beads:
        if NAME not in (entry.name or ""):
            raise RecordingError(
                f"beads: where {NAME} is in the name of one bead, it has to be in all",
                where=str(folder),
            )
        for k, stem in enumerate(stems):
            called = str(entry.name).replace(NAME, stem)
            axes = {axis: place(c, f"{called} {axis}", k) for axis, c in entry.axes.items()}
            beads.append(BeadColumns.model_validate({"name": called, **axes}))
    update: dict[str, Any] = {"beads": tuple(beads)}
    for key in ("time", "frame", "magnet", "rotation"):
        table = getattr(source, key)
        in_log = key == "magnet" and table is not None and table.is_log
        if table is not None and not in_log and not getattr(table, "in_log", False):
            update[key] = table.model_copy(update={"column": place(table.column, key)})
    clock = source.time or source.frame
    clocks = () if clock is None else tuple(
        place(clock.column, "time", k) - 1 for k in range(len(tables))
    )  # fmt: skip
    joined = SideBySide(
        path=folder,
        tables=tuple(tables),
        names=tuple(f"{s}/{n}" for s, t in zip(stems, tables, strict=True) for n in t.names),
        stated=tuple(one for table in tables for one in table.stated),
        clocks=clocks,
        guesses=tuple(dict.fromkeys(g for table in tables for g in table.guesses)),
    )
    return joined, source.model_copy(update=update)
