"""Rows of the beads, and of the models of their force–extension curves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mtpipe.report import words
from mtpipe.report.cells import Cell, estimate_cell
from mtpipe.report.findings import VERDICT_BEADS, Finding, bead_finding
from mtpipe.report.fit_words import FitSource, fit_source
from mtpipe.report.folder import RunFolder, records
from mtpipe.report.noise_words import noise_sentence


@dataclass(frozen=True)
class BeadRow:
    """One bead of the overview and the head of its own page.

    `fit` says which fit describes its spectra. `radius` is as the joint fit has it, `radius_stated`
    what the setup says. `noise` compares the spectra's with the images', where mtpipe tracked
    them; else it is empty.
    """

    bead: str
    verdict: str
    finding: Finding
    plateaus: str
    forces: Cell
    contour_length: Cell
    persistence_length: Cell
    stretch_modulus: Cell
    friction_ratio: Cell
    radius: Cell
    radius_stated: str
    noise: str
    fit: FitSource | None
    tether_model: str

    @property
    def mark(self) -> str:
        """Sign of the verdict, so that it does not rest on colour."""
        return words.VERDICT_MARK[self.verdict]

    @property
    def rank(self) -> int:
        """Sort key of the verdict: good first."""
        return list(VERDICT_BEADS).index(self.verdict)


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
            fit=quality(row["chi2"], row["dof"], row["p_value"], "χ²"),
        )
        for row in records(table)
    ]


def _bead_row(row: Mapping[str, Any], folder: RunFolder) -> BeadRow:
    no_curve = "no force–extension fit"
    low, high = row["force_min_pN"], row["force_max_pN"]
    stated = folder.setup.beads.radius_nm
    forces = folder.forces[folder.forces["bead"] == row["bead"]]
    return BeadRow(
        bead=row["bead"],
        verdict=row["verdict"],
        finding=bead_finding(folder, row),
        plateaus=f"{int(row['plateaus_used'])} of {int(row['plateaus'])}",
        forces=Cell(
            words.span(low, high),
            "" if words.is_number(high) else "no plateau gives a force; the finding says why",
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
            "taken as exact" if stated.known and not stated.stderr else "no joint fit gives it",
        ),
        radius_stated=words.measured(stated, "nm"),
        noise=noise_sentence(row),
        fit=fit_source(row, records(forces), radius_known=stated.known),
        tether_model=words.MODEL.get(words.text(row["tether_model"]), ""),
    )


def quality(statistic: Any, dof: Any, p_value: Any, name: str) -> str:
    """How well a fit describes its data, in words; empty where there is none."""
    if not (words.is_number(statistic) and words.is_number(dof)):
        return ""
    degrees = "degree" if dof == 1 else "degrees"
    shown = f"{name} {words.number(statistic, 4)} for {words.number(dof, 4)} {degrees} of freedom"
    return shown + (f", p = {words.number(p_value, 2)}" if words.is_number(p_value) else "")
