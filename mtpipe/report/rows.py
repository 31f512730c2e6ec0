"""Rows of the report's tables: every cell with the text shown, its explanation and its sort key."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mtpipe.report import words
from mtpipe.report.fit_words import ForceSource, force_source
from mtpipe.report.folder import RunFolder, records
from mtpipe.report.noise_words import noise_sentence
from mtpipe.report.plateau_forces import comparisons, share_a_force

VERDICTS = ("good", "unchecked", "caution", "refused")


@dataclass(frozen=True)
class Cell:
    """What a cell shows; `note` is its interval, or the reason why it is empty.

    `rows` is how many rows of the table it spans; `below` stands in it in small type.
    """

    shown: str
    note: str = ""
    sort: float | None = None
    rows: int = 1
    below: str = ""

    @property
    def empty(self) -> bool:
        """Whether there is no value to show."""
        return self.shown == words.EMPTY


@dataclass(frozen=True)
class BeadRow:
    """One bead of the overview and the head of its own page.

    `radius` is as the joint fit tells it, `radius_stated` what the setup says. `noise` compares the
    spectra's with the images', where mtpipe tracked them; else it is empty.
    """

    bead: str
    verdict: str
    reasons: tuple[str, ...]
    plateaus: str
    forces: Cell
    contour_length: Cell
    persistence_length: Cell
    stretch_modulus: Cell
    friction_ratio: Cell
    radius: Cell
    radius_stated: str
    noise: str
    source: ForceSource | None
    tether_model: str

    @property
    def mark(self) -> str:
        """Sign of the verdict, so that it does not rest on colour."""
        return words.VERDICT_MARK[self.verdict]

    @property
    def rank(self) -> int:
        """Sort key of the verdict: good first."""
        return VERDICTS.index(self.verdict)


@dataclass(frozen=True)
class ForceRow:
    """One axis of one plateau.

    `alone` is the force that the axis tells by itself, `difference` that of x and y in standard
    errors. None: the cell above spans this row.
    """

    key: str
    axis: str
    force: Cell | None
    alone: Cell
    difference: Cell | None
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
class PlateauRows:
    """The axes of one plateau; `force_shared` says whether x and y have one force."""

    plateau: int
    magnet: Cell
    times: str
    lost: str
    extension: Cell
    force_shared: bool
    axes: tuple[ForceRow, ...]


@dataclass(frozen=True)
class ModelRow:
    """One model of the force–extension curve."""

    model: str
    recommended: bool
    forces: str
    points: str
    contour_length: Cell
    persistence_length: Cell
    stretch_modulus: Cell
    fit: str


def bead_rows(folder: RunFolder) -> list[BeadRow]:
    """Rows of the overview, good beads first, then by name (numbers in names in their order)."""
    rows = [_bead_row(row, folder) for row in records(folder.beads)]
    return sorted(rows, key=lambda row: (row.rank, words.natural(row.bead)))


def plateau_rows(folder: RunFolder, bead: str) -> list[PlateauRows]:
    """The forces table of a bead: its plateaus in order, each with its axes."""
    table = folder.forces[folder.forces["bead"] == bead].sort_values(["plateau", "axis"])
    groups: dict[int, list[dict[str, Any]]] = {}
    for row in records(table):
        groups.setdefault(int(row["plateau"]), []).append(row)
    differences = {one.plateau: one.difference for one in comparisons(table)}
    return [
        PlateauRows(
            plateau=plateau,
            magnet=_plain(rows[0]["magnet_mm"], "the recording has no magnet position"),
            times=_times(rows[0]["start_s"], rows[0]["duration_s"]),
            lost=_lost(rows),
            extension=_extension(rows[0], len(rows)),
            force_shared=share_a_force(rows),
            axes=_axes(rows, differences.get(plateau)),
        )
        for plateau, rows in groups.items()
    ]


def model_rows(folder: RunFolder, bead: str) -> list[ModelRow]:
    """The force–extension models fitted to a bead."""
    table = folder.force_extension[folder.force_extension["bead"] == bead]
    return [
        ModelRow(
            model=words.MODEL.get(row["model"], row["model"]),
            recommended=bool(row["recommended"]),
            forces=words.span(row["force_low_pN"], row["force_high_pN"]),
            points=words.number(row["points"]),
            contour_length=estimate_cell(
                row, "contour_length", "nm", "the fit does not determine it"
            ),
            persistence_length=estimate_cell(
                row, "persistence_length", "nm", "the fit does not determine it"
            ),
            stretch_modulus=estimate_cell(
                row,
                "stretch_modulus",
                "pN",
                "the fit does not determine it"
                if row["model"] == "extensible"
                else "this model is inextensible",
            ),
            fit=_quality(row["chi2"], row["dof"], row["p_value"], "χ²"),
        )
        for row in records(table)
    ]


def _bead_row(row: Mapping[str, Any], folder: RunFolder) -> BeadRow:
    no_curve = "no force–extension fit; the reasons say why"
    low, high = row["force_min_pN"], row["force_max_pN"]
    stated = folder.setup.beads.radius_nm
    forces = folder.forces[folder.forces["bead"] == row["bead"]]
    return BeadRow(
        bead=row["bead"],
        verdict=row["verdict"],
        reasons=tuple(r.strip(" .") for r in words.text(row["reasons"]).split("|") if r.strip()),
        plateaus=f"{int(row['plateaus_used'])} of {int(row['plateaus'])}",
        forces=Cell(
            words.span(low, high),
            "" if words.is_number(high) else "no plateau gave a force; the reasons say why",
            high if words.is_number(high) else None,
        ),
        contour_length=estimate_cell(row, "contour_length", "nm", no_curve),
        persistence_length=estimate_cell(row, "persistence_length", "nm", no_curve),
        stretch_modulus=estimate_cell(
            row, "stretch_modulus", "pN", "only the extensible model has it"
        ),
        friction_ratio=Cell(
            words.with_error(row["friction_ratio"], row["friction_ratio_stderr"]),
            "" if words.is_number(row["friction_ratio"]) else "no friction was determined",
            row["friction_ratio"] if words.is_number(row["friction_ratio"]) else None,
        ),
        radius=estimate_cell(
            row,
            "radius",
            "nm",
            "taken as exact" if stated.known and not stated.stderr else "no joint fit tells it",
        ),
        radius_stated=words.measured(stated, "nm"),
        noise=noise_sentence(row),
        source=force_source(row, records(forces), radius_known=stated.known),
        tether_model=words.MODEL.get(words.text(row["tether_model"]), ""),
    )


def _force_row(row: Mapping[str, Any]) -> ForceRow:
    status, axis = words.text(row["status"]), row["axis"]
    tied = [words.label(name) for name in words.flags(row["tied_to"])]
    why = {
        "refused": "the trace was refused",
        "not_identified": f"the data tell only {words.listed(tied)} together"
        if len(tied) > 1
        else "the data do not determine it",
        "not_converged": "the fit did not converge",
    }.get(status, "not determined")
    codes = words.flags(row["flags"])
    remarks = []
    if status not in ("ok", "refused", *codes):
        remarks.append(words.STATUS.get(status, words.label(status)))
    sampled = words.is_number(row["posterior_rhat"])
    if sampled and not row["posterior_converged"] and "not_converged" not in codes:
        remarks.append("posterior not converged")
    if status != "refused" and axis != "z" and not words.is_number(row["force_pN"]):
        why_no_force = why if words.is_number(row["extension_nm"]) else "there is no extension"
        remarks.append(f"no force: {why_no_force}")
    return ForceRow(
        key=f"{int(row['plateau'])}/{axis}",
        axis=axis,
        force=estimate_cell(row, "force", "pN", "no force is taken from z" if axis == "z" else why),
        alone=estimate_cell(
            row, "force_axis", "pN", "no force is taken from z" if axis == "z" else why
        ),
        difference=Cell(words.EMPTY, "not both x and y tell a force by themselves"),
        stiffness=estimate_cell(row, "stiffness", "pN_per_nm", why, 1e3),
        friction=estimate_cell(row, "friction", "pN_s_per_nm", why, 1e6),
        corner=estimate_cell(row, "corner_frequency", "hz", why),
        radius=estimate_cell(row, "effective_radius", "nm", why),
        noise=estimate_cell(row, "noise", "nm", why),
        fit=Cell(
            words.number(row["fit_p_value"], 2),
            _quality(row["fit_deviance"], row["fit_dof"], row["fit_p_value"], "deviance"),
        ),
        status=status,
        flags=tuple(code for code in codes if code != "refused"),
        remarks=tuple(filter(None, (words.text(row["refusal"]).rstrip("."), *remarks))),
    )


def estimate_cell(
    row: Mapping[str, Any], quantity: str, unit: str, why_empty: str, factor: float = 1.0
) -> Cell:
    """An estimate from its four columns, times a factor."""
    value, stderr, low, high = (
        math.nan if cell is None else factor * cell
        for cell in (row[f"{quantity}{part}_{unit}"] for part in ("", "_stderr", "_low", "_high"))
    )
    symbol = _SYMBOL.get(unit, unit)
    if words.is_number(value):
        shown = words.with_arms(value, stderr, low, high)
        return Cell(shown, words.interval(low, high, symbol), value)
    if words.is_number(low) and high == math.inf:
        return Cell(f"> {words.number(low)}", f"{why_empty}; lower limit at 68 %")
    remains = words.interval(low, high, symbol)
    return Cell(words.EMPTY, f"{why_empty}; {remains}" if remains else why_empty)


def _axes(
    rows: Sequence[Mapping[str, Any]], difference: tuple[float, float] | None
) -> tuple[ForceRow, ...]:
    """The rows of one plateau; x and y have one cell for what they have in common."""
    axes = {row["axis"]: _force_row(row) for row in rows}
    x, y = axes.get("x"), axes.get("y")
    if x is not None and x.force is not None and y is not None:
        if share_a_force(rows):
            x = replace(x, force=replace(x.force, rows=2, below="x and y share it"))
            y = replace(y, force=None)
        if difference is not None:
            x, y = replace(x, difference=_difference(*difference)), replace(y, difference=None)
        axes |= {"x": x, "y": y}
    return tuple(axes.values())


def _difference(value: float, stderr: float) -> Cell:
    note = f"force from x less that from y: {words.with_error(value, stderr)} pN"
    return Cell(words.signed(value / stderr, 1), note, rows=2)


def _extension(row: Mapping[str, Any], rows: int) -> Cell:
    shown = words.with_error(row["extension_nm"], row["extension_stderr_nm"])
    return Cell(
        shown, "z was not recorded or has no zero" if shown == words.EMPTY else "", rows=rows
    )


def _times(start_s: Any, duration_s: Any) -> str:
    if not (words.is_number(start_s) and words.is_number(duration_s)):
        return words.EMPTY
    return f"{start_s:.0f} – {start_s + duration_s:.0f}"


def _lost(axes: Sequence[Mapping[str, Any]]) -> str:
    """Share of the frames lost in the axis that lost most; empty where none lost any."""
    share = max(row["lost_frames"] / row["frames"] if row["frames"] else 0.0 for row in axes)
    return f"{words.number(100 * share, 2)} % lost" if share > 0 else ""


def _plain(value: Any, why_empty: str) -> Cell:
    shown = words.number(value, 4)
    return Cell(shown, why_empty if shown == words.EMPTY else "")


def _quality(statistic: Any, dof: Any, p_value: Any, name: str) -> str:
    if not (words.is_number(statistic) and words.is_number(dof)):
        return ""
    shown = f"{name} {words.number(statistic, 4)} for {words.number(dof, 4)} degrees of freedom"
    return shown + (f", p = {words.number(p_value, 2)}" if words.is_number(p_value) else "")


_SYMBOL = {"pN_per_nm": "× 10⁻³ pN/nm", "pN_s_per_nm": "× 10⁻⁶ pN·s/nm", "hz": "Hz"}
