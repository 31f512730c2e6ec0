"""Rows of the table that sets the forces by other methods of the field beside mtpipe's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mtpipe.report import words
from mtpipe.report.folder import RunFolder, records
from mtpipe.report.rows import Cell, PlateauRows, estimate_cell


@dataclass(frozen=True)
class MethodRow:
    """One trace: the force given (None: the cell above spans this row), and those beside it."""

    plateau: int
    axis: str
    given: Cell | None
    alone: Cell
    others: tuple[Cell, ...]


def method_rows(
    folder: RunFolder, bead: str, plateaus: Sequence[PlateauRows]
) -> tuple[list[str], list[MethodRow]]:
    """Names of the other methods that were asked for, and a row for each trace they were given."""
    others = folder.others[folder.others["bead"] == bead]
    names = list(others["method"].unique())
    by_trace = {(row["plateau"], row["axis"], row["method"]): row for row in records(others)}
    return names, [
        MethodRow(
            plateau=plateau.plateau,
            axis=own.axis,
            given=own.force,
            alone=own.alone,
            others=tuple(
                estimate_cell(other, "force", "pN", words.text(other["refusal"]) or "no force")
                for name in names
                if (other := by_trace.get((plateau.plateau, own.axis, name)))
            ),
        )
        for plateau in plateaus
        for own in plateau.axes
        if names and (plateau.plateau, own.axis, names[0]) in by_trace
    ]
