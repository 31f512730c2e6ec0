"""A run as a reader's marks leave it: its forces, curves and beads without what is left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.curves.curve_tables import curves_of_tables, force_extension_table, tether_columns
from mtpipe.curves.extension_curve import ForceExtension, fit_curves
from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.files import write_atomically
from mtpipe.ground.notice import Notice
from mtpipe.ground.spreadsheets import as_csv
from mtpipe.report import words
from mtpipe.report.folder import RunFolder, read_run_folder, records
from mtpipe.report.marks import Mark, read_marks
from mtpipe.report.plateau_forces import EXCLUDED

# Notices of curves, which are fitted again.
OF_CURVES = ("near_surface", "off_the_curve", "tether_")


def read_marked_run(folder: Path) -> RunFolder:
    """A run folder as its marks leave it.

    Raises
    ------
    RunFolderError, MtpipeError : as `read_run_folder` and `read_marks`.
    """
    return with_marks(read_run_folder(folder), read_marks(folder))


def check_place(run: RunFolder, mark: Mark) -> None:
    """Raise MtpipeError if a mark is of a bead, plateau or time that the run does not have."""
    mine = run.forces[run.forces["bead"] == mark.bead]
    beads = list(run.beads["bead"])
    if mark.bead not in beads:
        listed = ", ".join(beads)
        raise MtpipeError(f"the run has no bead {mark.bead!r}", mend=f"Its beads: {listed}.")
    numbers = sorted({int(number) for number in mine["plateau"]})
    if mark.plateau is not None and mark.plateau not in numbers:
        shown = words.plateaus(numbers) if numbers else "none"
        raise MtpipeError(
            f"bead {mark.bead} has no plateau {mark.plateau}", mend=f"It has {shown}."
        )
    if mark.stretch_s is not None and not any(_covers(mark, row) for row in records(mine)):
        raise MtpipeError(f"no plateau of bead {mark.bead} lies in this stretch of time")


def with_marks(run: RunFolder, marks: Sequence[Mark]) -> RunFolder:
    """The run without what is marked; marks of what it does not have are told.

    `forces` and `beads` have the reason in `excluded`, and `force_status` is "excluded". Curves are
    fitted again to the other points.
    """
    if not marks:
        forces, beads = run.forces.assign(excluded=""), run.beads.assign(excluded="")
        return replace(run, forces=forces, beads=beads)
    applied = {_stretch(one) for one in run.run.get("marks", [])}
    notices, fresh = [], []
    for mark in marks:
        if mark.stretch_s is not None and _stretch(vars(mark)) in applied:
            continue  # the run has left it out itself, and says so
        try:
            check_place(run, mark)
        except MtpipeError as error:
            notices.append(Notice("mark_of_nothing", "caution", f"marks.toml: {error}"))
        else:
            fresh.append(mark)
            notices.append(_notice(mark))
    excluded = {
        (mark.bead, int(row["plateau"])): mark.reason
        for mark in fresh
        for row in records(run.forces[run.forces["bead"] == mark.bead])
        if _covers(mark, row)
    }
    whole = {one.bead: one.reason for one in fresh if one.plateau is None and one.stretch_s is None}
    curves = _curves(run, excluded)
    kept = [note for note in run.notices if not note.code.startswith(OF_CURVES)]
    of_curves = [note for curve in curves.values() for note in curve.notices]
    forces = _marked(run.forces, excluded)
    return replace(
        run,
        forces=forces,
        others=_marked(run.others, excluded),
        beads=_beads(run.beads, forces, whole, curves),
        force_extension=force_extension_table(curves),
        notices=(*kept, *of_curves, *notices),
    )


def write_csv(folder: Path, run: RunFolder) -> None:
    """Write `forces.csv` and `beads.csv` of a run as its marks leave it."""
    every = [run.forces, *([run.others.assign(excluded="")] if len(run.others) else [])]
    write_atomically(folder / "forces.csv", as_csv(pd.concat(every, ignore_index=True)))
    write_atomically(folder / "beads.csv", as_csv(run.beads))


def _stretch(mark: Mapping[str, Any]) -> tuple[Any, ...]:
    return mark["bead"], mark["from_s"], mark["to_s"]


def _covers(mark: Mark, row: Mapping[str, Any]) -> bool:
    """Whether a mark is of a plateau of its bead; a stretch, of any that it has time in common."""
    if mark.stretch_s is not None:
        ends = row["start_s"] + row["duration_s"]
        return bool(mark.stretch_s[0] < ends and row["start_s"] < mark.stretch_s[1])
    return mark.plateau in (None, int(row["plateau"]))


def _notice(mark: Mark) -> Notice:
    if mark.stretch_s is None:
        said = f"Left out by hand: {mark.reason}"
        return Notice("left_out_by_hand", "info", said, bead=mark.bead, plateau=mark.plateau)
    begin, end = mark.stretch_s
    said = (
        f"{begin:g} to {end:g} s is left out by hand ({mark.reason}). Until you give mtpipe run "
        "again, the plateaus it lies in are left out as a whole."
    )
    return Notice("left_out_by_hand", "caution", said, bead=mark.bead)


def _marked(table: pd.DataFrame, excluded: Mapping[tuple[str, int], str]) -> pd.DataFrame:
    pairs = zip(table["bead"], table["plateau"], strict=True)
    reasons = pd.Series([excluded.get((b, int(p)), "") for b, p in pairs], table.index, dtype="str")
    status = table["force_status"].mask((reasons != "") & (table["force_status"] != ""), EXCLUDED)
    return table.assign(excluded=reasons, force_status=status)


def _curves(run: RunFolder, excluded: Mapping[tuple[str, int], str]) -> dict[str, ForceExtension]:
    def kept(table: pd.DataFrame, plateau: str = "plateau") -> pd.DataFrame:
        pairs = zip(table["bead"], table[plateau], strict=True)
        return table[np.array([(b, int(p)) not in excluded for b, p in pairs], dtype=bool)]

    points, stage = kept(run.curve_points), kept(kept(run.curve_stage), "other_plateau")
    usable = {
        bead: one
        for bead, one in curves_of_tables(points, stage, run.assay).items()
        if one[0].usable().any()
    }
    return fit_curves(usable)


def _beads(
    beads: pd.DataFrame,
    forces: pd.DataFrame,
    whole: Mapping[str, str],
    curves: Mapping[str, ForceExtension],
) -> pd.DataFrame:
    rows = []
    for row in records(beads):
        bead, curve = row["bead"], curves.get(row["bead"])
        mine = forces[(forces["bead"] == bead) & (forces["excluded"] == "")]
        once = mine[mine["force_status"] == "ok"].drop_duplicates("plateau")
        fit = curve.recommended if curve is not None else None
        changed: dict[str, Any] = {
            "tether_model": fit.model if fit else "",
            **tether_columns(fit),
            "excluded": whole.get(bead, ""),
        }
        if ((forces["bead"] == bead) & (forces["excluded"] != "")).any():
            changed |= {
                "plateaus_used": len(once),
                "force_min_pN": once["force_pN"].min(),
                "force_max_pN": once["force_pN"].max(),
            }
        if bead in whole:
            said = f"left out by hand: {whole[bead]}"
            reasons = " | ".join(filter(None, [said, words.text(row["reasons"])]))
            changed |= {"verdict": "refused", "reasons": reasons}
        rows.append(row | changed)
    return pd.DataFrame(rows).astype(
        {name: beads[name].dtype for name in ("verdict", "reasons", "tether_model")}
    )
