"""What the report shows of a cross-check: sentence, cells of the map, the clearest differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.ground.notice import Notice
from mtpipe.report import crosscheck_words
from mtpipe.report.folder import records

MOST_LISTED = 8
LISTED_BELOW = 1e-3
# Of one statistic along one axis at most this many are listed: neighbours say the same.
MOST_OF_A_KIND = 2
AXIS_ORDER = ("x", "y", "z", "xy", "xz", "yz", "")


@dataclass(frozen=True)
class MapCell:
    """A cell of the map: the smallest of its p-values, times their number, at most 1."""

    line: str
    plateau: int | None
    p_value: float
    text: str


@dataclass(frozen=True)
class CrossCheckRows:
    """A bead's cross-check. `refused`: why there is none."""

    sentence: str
    refused: str
    cells: tuple[MapCell, ...]
    lines: tuple[str, ...]
    listed: tuple[str, ...]

    @property
    def done(self) -> bool:
        """Whether the bead was cross-checked."""
        return bool(self.cells)


def crosscheck_rows(table: pd.DataFrame, notices: Sequence[Notice] = ()) -> CrossCheckRows:
    """The cross-check of a bead.

    Parameters
    ----------
    table : its rows of `crosscheck`.
    notices : about it, which say why there may be none.
    """
    if table.empty:
        codes = ("not_crosschecked", "crosscheck_failed")
        reasons = [n.message for n in notices if n.code in codes]
        return CrossCheckRows("", (reasons or ["This run was not cross-checked."])[0], (), (), ())
    compared = [_plain(row) for row in records(table.sort_values("p_value", kind="stable"))]
    first = compared[0]
    cells = _cells(compared)
    return CrossCheckRows(
        crosscheck_words.verdict(first["bead_p_value"], len(compared), int(first["simulations"])),
        "",
        cells,
        tuple(dict.fromkeys(cell.line for cell in cells)),
        tuple(crosscheck_words.comparison(row) for row in _clearest(compared)),
    )


def _plain(row: dict[str, Any]) -> dict[str, Any]:
    """A row whose plateau is an integer, or None where it takes all of them together."""
    plateau = row["plateau"]
    return row | {"plateau": None if pd.isna(plateau) else int(plateau)}


def _clearest(compared: list[dict[str, Any]]) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    kinds: dict[tuple[str, str], int] = {}
    for row in compared:
        kind = row["statistic"], row["axis"]
        kinds[kind] = kinds.get(kind, 0) + 1
        if row["p_value"] < LISTED_BELOW and kinds[kind] <= MOST_OF_A_KIND:
            found.append(row)
    return found[:MOST_LISTED]


def _cells(compared: list[dict[str, Any]]) -> tuple[MapCell, ...]:
    """Cells by line (axis, then bands by frequency, then the others) and plateau."""
    groups: dict[tuple[str, str, int | None], list[dict[str, Any]]] = {}
    for row in compared:
        key = row["axis"], crosscheck_words.line_of(row), row["plateau"]
        groups.setdefault(key, []).append(row)
    order = {
        (axis, line): (
            AXIS_ORDER.index(axis) if axis in AXIS_ORDER else len(AXIS_ORDER),
            rows[0]["band_low_hz"] if rows[0]["statistic"] == "psd_band" else np.inf,
            line,
        )
        for (axis, line, _), rows in groups.items()
    }
    cells = []
    for key in sorted(groups, key=lambda k: (order[k[0], k[1]], -1 if k[2] is None else k[2])):
        axis, line, plateau = key
        rows = groups[key]
        p_value = min(1.0, len(rows) * float(rows[0]["p_value"]))
        name = f"{axis} {line}".strip()
        cells.append(MapCell(name, plateau, p_value, crosscheck_words.comparison(rows[0])))
    return tuple(cells)
