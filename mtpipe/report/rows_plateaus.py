"""Rows of a bead's two tables by plateau: forces, and what was fitted to each axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

from mtpipe.report import words
from mtpipe.report.cells import Cell, error_cell, estimate_cell, plain_cell
from mtpipe.report.folder import RunFolder, records
from mtpipe.report.plateau_forces import comparisons
from mtpipe.report.rows import quality

NO_FIT = "no fit of the whole experiment"
# Letters of a reason that is told once in a table: refusals and a reader's own are sentences.
LONG_REASON = 40
# Words of a status that a flag says already.
SAID_BY_FLAG = {"unlike_model": "poor_fit"}


@dataclass(frozen=True)
class PlateauForces:
    """Forces of one plateau: the one to quote, and the others beside it by name.

    `alone` are those of x and y alone, `difference` theirs in standard errors; `corrected` is the
    force with a smooth correction of the spectrum free, `between` the range that holds both.
    """

    plateau: int
    magnet: Cell
    times: str
    lost: str
    extension: Cell
    quoted: Cell
    source: str
    alone: tuple[Cell, Cell]
    difference: Cell
    configured: Cell
    named: Cell
    corrected: Cell
    between: Cell


@dataclass(frozen=True)
class ForceTable:
    """Forces of a bead by plateau, and which of the others are there in any plateau."""

    rows: tuple[PlateauForces, ...]
    has_configured: bool
    has_named: bool
    has_corrected: bool


@dataclass(frozen=True)
class AxisFit:
    """What was fitted to one axis of one plateau; `status` is the word of `forces.csv`."""

    key: str
    plateau: int
    axis: str
    magnet: Cell
    alone: Cell
    stiffness: Cell
    friction: Cell
    corner: Cell
    radius: Cell
    noise: Cell
    fit: Cell
    status: str
    flags: tuple[str, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class FitBlock:
    """Rows of the table of fits that belong together.

    They are the axes of one plateau; or, with `refusal`, the axes of the first of some plateaus
    that are refused for this reason in all axes.
    """

    plateaus: str
    fits: tuple[AxisFit, ...]
    refusal: str


def force_table(run: RunFolder, bead: str) -> ForceTable:
    """The table of forces of a bead, its plateaus in order."""
    table = run.forces[run.forces["bead"] == bead]
    groups: dict[int, list[dict[str, Any]]] = {}
    for row in records(table.sort_values(["plateau", "axis"])):
        groups.setdefault(int(row["plateau"]), []).append(row)
    differences = {one.plateau: one.difference for one in comparisons(table)}
    left = run.unexplained.get(bead, {"correction": None})["correction"] or {"forces": ()}
    corrected = {row["plateau"]: row for row in left["forces"]}
    rows = tuple(
        _plateau(plateau, axes, differences.get(plateau), corrected.get(plateau))
        for plateau, axes in groups.items()
    )
    return ForceTable(
        _reasons_once(rows),
        has_configured=any(not row.configured.empty for row in rows),
        has_named=any(not row.named.empty for row in rows),
        has_corrected=bool(corrected),
    )


def axis_fits(run: RunFolder, bead: str) -> list[AxisFit]:
    """What was fitted, by plateau and axis."""
    table = run.forces[run.forces["bead"] == bead].sort_values(["plateau", "axis"])
    return [_axis_fit(row) for row in records(table)]


def fit_blocks(fits: Sequence[AxisFit]) -> list[FitBlock]:
    """The table of fits, with one row for neighbours that are refused for the same reason."""
    by_plateau: dict[int, list[AxisFit]] = {}
    for one in fits:
        by_plateau.setdefault(one.plateau, []).append(one)
    blocks = []
    for alike, group in groupby(by_plateau.values(), key=_refused_as):
        together = list(group)
        if alike is None:
            blocks += [FitBlock(str(axes[0].plateau), tuple(axes), "") for axes in together]
        else:
            _, refusal, _ = alike
            numbers = words.ranges([axes[0].plateau for axes in together])
            blocks.append(FitBlock(numbers, tuple(together[0]), refusal))
    return blocks


def _refused_as(axes: Sequence[AxisFit]) -> tuple[Any, ...] | None:
    """Axes, reason and flags of a plateau that is refused in all axes for one reason; or None."""
    refused = {("; ".join(one.remarks), one.flags) for one in axes if one.status == "refused"}
    if len(refused) != 1 or any(one.status != "refused" for one in axes):
        return None
    return (tuple(one.axis for one in axes), *next(iter(refused)))


def _reasons_once(rows: Sequence[PlateauForces]) -> tuple[PlateauForces, ...]:
    """Rows in which a long reason for no force stands once, and then where it is to be read."""
    first: dict[str, int] = {}
    return tuple(_said_above(row, first.setdefault(row.source, row.plateau)) for row in rows)


def _said_above(row: PlateauForces, first: int) -> PlateauForces:
    if first == row.plateau or len(row.source) <= LONG_REASON:
        return row
    said = f"as in plateau {first}"
    quoted = replace(row.quoted, note=said) if row.quoted.empty else row.quoted
    return replace(row, source=said, quoted=quoted)


def _plateau(
    plateau: int,
    axes: Sequence[Mapping[str, Any]],
    difference: tuple[float, float] | None,
    corrected: Mapping[str, Any] | None,
) -> PlateauForces:
    first = axes[0]
    by_axis = {row["axis"]: row for row in axes}
    missing = Cell(words.EMPTY, "this axis was not recorded")
    uncorrected = Cell(words.EMPTY, "no correction was fitted")
    return PlateauForces(
        plateau=plateau,
        magnet=_magnet(first),
        times=_times(first["start_s"], first["duration_s"]),
        lost=_lost(axes),
        extension=error_cell(
            first["extension_nm"], first["extension_stderr_nm"], "z was not recorded or has no zero"
        ),
        quoted=estimate_cell(first, "force", "pN", _why_no_force(axes)),
        source=_source(first, axes),
        alone=tuple(
            estimate_cell(by_axis[name], "force_axis", "pN", why_empty(by_axis[name]))
            if name in by_axis
            else missing
            for name in ("x", "y")
        ),  # type: ignore[arg-type]
        difference=_difference(difference),
        configured=error_cell(
            first["force_configured_pN"], first["force_configured_stderr_pN"], NO_FIT
        ),
        named=error_cell(first["force_named_pN"], first["force_named_stderr_pN"], "nothing named"),
        corrected=error_cell(corrected["corrected_pN"], corrected["corrected_stderr_pN"], "")
        if corrected
        else uncorrected,
        between=Cell(words.span(corrected["low_pN"], corrected["high_pN"]))
        if corrected
        else uncorrected,
    )


def _source(row: Mapping[str, Any], axes: Sequence[Mapping[str, Any]]) -> str:
    """Where the force to quote comes from, or why there is none to use."""
    if row["excluded"]:
        return f"left out by hand: {row['excluded']}"
    if not words.is_number(row["force_pN"]):
        return _why_no_force(axes)
    return words.SOURCE.get(row["force_source"], words.text(row["force_source"]))


def _axis_fit(row: Mapping[str, Any]) -> AxisFit:
    status, axis, plateau = words.text(row["status"]), row["axis"], int(row["plateau"])
    codes = words.flags(row["flags"])
    why = why_empty(row)
    remarks = [words.text(row["refusal"]).rstrip(".")]
    if status not in ("ok", "refused", *codes) and SAID_BY_FLAG.get(status) not in codes:
        remarks.append(words.STATUS.get(status, words.label(status)))
    sampled = words.is_number(row["posterior_rhat"])
    if sampled and not row["posterior_converged"] and "not_converged" not in codes:
        remarks.append("posterior not converged")
    return AxisFit(
        key=f"{plateau}/{axis}",
        plateau=plateau,
        axis=axis,
        magnet=_magnet(row),
        alone=estimate_cell(row, "force_axis", "pN", why),
        stiffness=estimate_cell(row, "stiffness", "pN_per_nm", why, 1e3),
        friction=estimate_cell(row, "friction", "pN_s_per_nm", why, 1e6),
        corner=estimate_cell(row, "corner_frequency", "hz", why),
        radius=estimate_cell(row, "effective_radius", "nm", why),
        noise=estimate_cell(row, "noise", "nm", why),
        fit=Cell(
            words.number(row["fit_p_value"], 2),
            quality(row["fit_deviance"], row["fit_dof"], row["fit_p_value"], "deviance"),
        ),
        status=status,
        flags=tuple(code for code in codes if code != "refused"),
        remarks=tuple(filter(None, remarks)),
    )


def why_empty(row: Mapping[str, Any]) -> str:
    """Why a trace has no number."""
    if row["axis"] == "z":
        return "no force is taken from z"
    tied = [words.label(name) for name in words.flags(row["tied_to"])]
    return {
        "refused": "the trace was refused",
        "not_one_state": "the plateau mixes states",
        "not_identified": f"the data determine only {words.listed(tied)} together"
        if len(tied) > 1
        else "the data do not determine it",
        "not_converged": "the fit did not converge",
    }.get(words.text(row["status"]), "not determined")


def _why_no_force(axes: Sequence[Mapping[str, Any]]) -> str:
    """Why a plateau has no force to quote: the reason of x or y, or that there is no extension."""
    lateral = [row for row in axes if row["axis"] in ("x", "y")] or list(axes)
    told = next((words.text(row["refusal"]) for row in lateral if words.text(row["refusal"])), "")
    if told:
        return told.rstrip(".")
    if not words.is_number(lateral[0]["extension_nm"]):
        return "there is no extension"
    return why_empty(lateral[0])


def _difference(difference: tuple[float, float] | None) -> Cell:
    if difference is None:
        return Cell(words.EMPTY, "not both x and y give a force")
    value, stderr = difference
    note = f"force from x less that from y: {words.with_error(value, stderr)} pN"
    return Cell(words.signed(value / stderr, 1), note)


def _magnet(row: Mapping[str, Any]) -> Cell:
    return plain_cell(row["magnet_mm"], "the recording has no magnet position")


def _times(start_s: Any, duration_s: Any) -> str:
    if not (words.is_number(start_s) and words.is_number(duration_s)):
        return words.EMPTY
    return f"{start_s:.0f} – {start_s + duration_s:.0f}"


def _lost(axes: Sequence[Mapping[str, Any]]) -> str:
    """Share of the frames lost in the axis that lost most; empty where none lost any."""
    share = max(row["lost_frames"] / row["frames"] if row["frames"] else 0.0 for row in axes)
    return f"{words.number(100 * share, 2)} % of frames lost" if share > 0 else ""
