"""Rows of the table that sets the forces by other methods of the field beside mtpipe's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mtpipe.report import words
from mtpipe.report.cells import Cell, estimate_cell
from mtpipe.report.folder import RunFolder, records
from mtpipe.report.rows_plateaus import AxisFit


@dataclass(frozen=True)
class MethodRow:
    """One trace: the force of this axis alone, and those by the other methods."""

    plateau: int
    axis: str
    alone: Cell
    others: tuple[Cell, ...]


def method_rows(
    folder: RunFolder, bead: str, fits: Sequence[AxisFit]
) -> tuple[list[str], list[MethodRow]]:
    """Names of the other methods that were asked for, and a row for each trace they were given."""
    others = folder.others[folder.others["bead"] == bead]
    names = list(others["method"].unique())
    by_trace = {(row["plateau"], row["axis"], row["method"]): row for row in records(others)}
    return names, [
        MethodRow(
            plateau=own.plateau,
            axis=own.axis,
            alone=own.alone,
            others=tuple(
                estimate_cell(other, "force_axis", "pN", words.text(other["refusal"]) or "no force")
                for name in names
                if (other := by_trace.get((own.plateau, own.axis, name)))
            ),
        )
        for own in fits
        if names and (own.plateau, own.axis, names[0]) in by_trace
    ]
