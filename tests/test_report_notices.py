"""Notices as people read them: equal ones once, with all that they are about."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from mtpipe.cli.terminal import summary
from mtpipe.ground.notice import Notice
from mtpipe.report import write_report
from mtpipe.report.notices import Told, told_once
from tests.report_folder import NASTY, REFUSED, UNEXPLAINED, write_run_folder
from tests.report_page import Page

REFUSAL = "the bead moves 0.2 times as much as on a tether: it is probably stuck"


def refused(bead: str, plateau: int, axis: str, said: str = f"Refused: {REFUSAL}.") -> Notice:
    return Notice("refused", "info" if axis == "z" else "warning", said, bead, plateau, axis)


def notices(bead: str, plateaus: Sequence[int], axes: str = "xyz") -> list[Notice]:
    return [refused(bead, plateau, axis) for plateau in plateaus for axis in axes]


def test_equal_notices_are_told_once_with_their_plateaus_axes_and_beads() -> None:
    said = notices("b1", range(3, 39))[0].message
    assert told_once(notices("b1", range(3, 39))) == [
        Told(("b1",), "plateaus 3 to 38 along x, y and z", said)
    ]
    both = [*notices("b1", [0, 1, 5], "x"), *notices("b2", [0, 1, 5], "x")]
    assert told_once(both) == [Told(("b1", "b2"), "plateaus 0, 1 and 5 along x", said)]


def test_what_differs_stays_apart_and_nothing_is_lost() -> None:
    odd = refused("b1", 4, "x", "Refused: free.")
    mixed = [*notices("b1", [0, 1], "xy"), *notices("b1", [2], "x"), *notices("b2", [0], "xy"), odd]
    assert [(one.beads, one.place, one.message[:13]) for one in told_once(mixed)] == [
        (("b1",), "plateaus 0 and 1 along x and y", "Refused: the "),
        (("b1",), "plateau 2 along x", "Refused: the "),
        (("b2",), "plateau 0 along x and y", "Refused: the "),
        (("b1",), "plateau 4 along x", "Refused: free"),
    ]
    whole = Notice("no_zero", "caution", "z has no zero.")
    assert told_once([whole, whole]) == [Told((), "", "z has no zero.")]


def change_forces(folder: Path, bead: str, **values: Any) -> None:
    forces = pd.read_parquet(folder / "forces.parquet")
    for name, value in values.items():
        forces.loc[forces["bead"] == bead, name] = value
    forces.to_parquet(folder / "forces.parquet")


def tell(folder: Path, told: Sequence[Notice]) -> None:
    path = folder / "run.json"
    run = json.loads(path.read_text(encoding="utf-8"))
    run["notices"] = [vars(one) for one in told]
    path.write_text(json.dumps(run), encoding="utf-8")


@pytest.mark.slow
def test_a_bead_refused_for_one_reason_reads_it_once_in_each_part_of_its_page(
    tmp_path: Path,
) -> None:
    folder = write_run_folder(tmp_path / "run", plateaus=4)
    change_forces(folder, REFUSED, status="refused", refusal=f"{REFUSAL}.", flags="refused")
    tell(folder, notices(REFUSED, range(4)))
    index = Page(write_report(folder))
    assert index.words.count(REFUSAL) == 1
    assert f"{REFUSED}, plateaus 0 to 3 along x, y and z: Refused: {REFUSAL}." in index.words
    page = Page(folder / "report" / f"bead-{REFUSED}.html")
    assert ["0 to 3", "x,y,z", f"refused: {REFUSAL}"] in page.rows
    by_plateau = [row[5] for row in page.rows if len(row) > 8 and row[0] in "0123"]
    assert by_plateau == [REFUSAL, *["as in plateau 0"] * 3]
    assert len(json.loads((folder / "run.json").read_text(encoding="utf-8"))["notices"]) == 12


@pytest.mark.slow
def test_plateaus_that_mix_states_for_one_reason_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_run_folder(tmp_path / "run", good=1, plateaus=3)
    change_forces(folder, UNEXPLAINED, status="not_one_state", force_source="none")
    change_forces(folder, NASTY, status="not_one_state", force_source="none")
    mixed = "No force to use: the force changes in it."
    tell(
        folder,
        [
            Notice("not_one_state", "caution", mixed, bead, plateau)
            for bead in (NASTY, UNEXPLAINED)
            for plateau in range(3)
        ],
    )
    line = f"{NASTY} and {UNEXPLAINED}, plateaus 0 to 2: {mixed}"
    summary(folder)
    assert capsys.readouterr().out.count(line) == 1
    assert Page(write_report(folder)).lines.count(f"warning {line}") == 1
