"""What was found, in sentences: of beads, of the recording, on the pages and on the terminal."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from mtpipe.cli.terminal import summary
from mtpipe.effects.catalogue import catalogue
from mtpipe.report import write_report
from mtpipe.report.findings import Finding, bead_finding
from mtpipe.report.folder import read_run_folder, records
from mtpipe.report.remedies import remedy
from tests.report_folder import NASTY, NO_Z, REFUSED, UNEXPLAINED, write_run_folder
from tests.report_page import Page

pytestmark = pytest.mark.slow

GOOD = "bead-b-id-x-b-1-2.html"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_run_folder(tmp_path / "run", good=2, plateaus=3)


def finding(folder: Path, bead: str) -> Finding:
    run = read_run_folder(folder)
    return bead_finding(run, next(row for row in records(run.beads) if row["bead"] == bead))


def change_json(path: Path, change: Any) -> None:
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")


def change_bead(folder: Path, bead: str, **values: Any) -> None:
    beads = pd.read_parquet(folder / "beads.parquet")
    for name, value in values.items():
        beads.loc[beads["bead"] == bead, name] = value
    beads.to_parquet(folder / "beads.parquet")


def test_a_bead_says_what_where_and_how_large(folder: Path) -> None:
    found = finding(folder, UNEXPLAINED)
    assert found.headline.endswith("the cause is not known.")
    (sentence,) = found.details
    assert "the strongest narrow line along y at 30 Hz in plateau 1" in sentence
    assert sentence.endswith(": 9.5, simulated −1.9 to 2.1.")
    assert found.note == "What is not explained may move a force by up to 14 %."
    assert "→" in found.change
    assert found.change.endswith(", 25 % more")


def test_a_cause_of_a_part_is_not_said_to_be_unknown(folder: Path) -> None:
    def some(content: dict[str, Any]) -> None:
        named = {"effect": "z_response", "sentence": "The table is curved.", "parameters": {}}
        content["beads"][UNEXPLAINED]["effects"] = [named]

    change_json(folder / "mismatch.json", some)
    found = finding(folder, UNEXPLAINED)
    assert found.details[0] == "The table is curved."
    assert found.headline.endswith("What was found explains a part of it.")


def test_the_clearest_correction_of_a_spectrum_is_said_in_numbers(folder: Path) -> None:
    place = {"plateau": None, "band_hz": [0.4, 2.5], "factor": 1.16, "factor_stderr": 0.02}
    fainter = place | {"plateau": 2, "factor": 1.9, "factor_stderr": 0.4}

    def spectral(content: dict[str, Any]) -> None:
        content["beads"][UNEXPLAINED]["located"][0]["statistic"] = "psd_band"

    def left(content: dict[str, Any]) -> None:
        mine = json.loads(json.dumps(content["beads"][REFUSED]))
        mine["correction"]["axes"] = [
            {"axis": "y", "common": True, "places": [fainter, place | {"rms": 0.08}]}
        ]
        content["beads"][UNEXPLAINED] = mine

    change_json(folder / "mismatch.json", spectral)
    change_json(folder / "details/unexplained.json", left)
    assert finding(folder, UNEXPLAINED).details == (
        "The clearest difference: along y between 0.4 and 2.5 Hz the recorded power is "
        "16.0 ± 2.0 % above the expected.",
    )


def test_a_mismatch_that_does_not_matter_is_a_note(folder: Path) -> None:
    found = finding(folder, NASTY)
    assert found.note == "The mismatch is significant but moves no force by more than 3 %."
    change_json(folder / "run.json", lambda run: run["setup"].update(report={"tolerance": 0.05}))
    assert finding(folder, NASTY).note.endswith("more than 5 %.")
    change_bead(folder, NASTY, material=True)
    assert finding(folder, NASTY).note == ""


def test_what_is_not_explained_bounds_the_forces_to_quote_and_no_others(folder: Path) -> None:
    """Forces as configured may be far from those to quote, which stand in the line below."""
    change_bead(folder, UNEXPLAINED, material=False, force_bound_percent=2.73)
    assert finding(folder, UNEXPLAINED).note == (
        "What is not explained may move a force to quote by up to 2.7 %. That is within the "
        "tolerance of 3 %."
    )


def test_forces_of_a_consistent_bead_are_used_only_if_nothing_else_is_wrong(folder: Path) -> None:
    assert finding(folder, "more1").actions == ("Use the forces as they are.",)
    change_bead(folder, "more1", verdict="caution", reasons="its contour length is 2 nm")
    found = finding(folder, "more1")
    assert found.kind == "consistent"
    assert found.actions == ("Settle the points above before you use the forces.",)


def test_what_is_described_stands_with_its_terms(folder: Path) -> None:
    def described(content: dict[str, Any]) -> None:
        one = content["beads"][UNEXPLAINED]
        one |= {"verdict": "described", "terms": [{"sentence": "A Lorentzian at 3 Hz along y."}]}

    change_json(folder / "mismatch.json", described)
    change_bead(folder, UNEXPLAINED, mismatch="described")
    found = finding(folder, UNEXPLAINED)
    assert "No known cause explains all of it" in found.headline
    assert found.details == ("A Lorentzian at 3 Hz along y.",)


def test_an_unchecked_bead_says_what_that_means_and_how_to_check_it(folder: Path) -> None:
    assert finding(folder, NO_Z).details == ("It was not cross-checked: z is missing.",)
    change_bead(folder, "more1", mismatch="", verdict="unchecked")
    change_json(folder / "mismatch.json", lambda content: content["beads"].pop("more1"))
    found = finding(folder, "more1")
    assert found.kind == "unchecked"
    assert "gives a wrong force" in found.details[0]
    assert "without --no-crosscheck" in found.details[0]
    page = Page(write_report(folder))
    assert page.words.count("To check this, run mtpipe again without --no-crosscheck.") == 1
    assert "1 good, 1 unchecked, 2 caution, 1 refused." in page.words


def test_a_bead_without_a_force_is_not_told_that_its_force_may_be_wrong(folder: Path) -> None:
    change_bead(folder, "more1", mismatch="", verdict="caution")
    change_json(folder / "mismatch.json", lambda content: content["beads"].pop("more1"))
    forces = pd.read_parquet(folder / "forces.parquet")
    forces.loc[forces["bead"] == "more1", "force_pN"] = float("nan")
    forces.to_parquet(folder / "forces.parquet")
    (said,) = finding(folder, "more1").details
    assert said.startswith("The fit gives no force to quote.")
    assert "the force wrong" not in said


def test_a_refused_bead_says_why_and_nothing_of_forces(folder: Path) -> None:
    found = finding(folder, REFUSED)
    assert found.details == ("All traces refused: the bead is stuck to the surface.",)
    assert (found.note, found.forces, found.change, found.reasons) == ("", "", "", ())


def test_plateaus_that_mix_states_are_told_first(folder: Path) -> None:
    forces = pd.read_parquet(folder / "forces.parquet")
    mixed = (forces["plateau"] == 1) & forces["bead"].isin([NASTY, UNEXPLAINED])
    forces.loc[mixed, "status"] = "not_one_state"
    forces.loc[mixed, [c for c in forces if c.startswith("force") and c.endswith("_pN")]] = None
    forces.loc[mixed, "force_source"] = "none"
    forces.to_parquet(folder / "forces.parquet")
    message = "No force to use: the mean height steps by 80 nm at 34 s."

    def tell(run: dict[str, Any]) -> None:
        run["notices"] += [
            {"code": code, "severity": severity, "message": said, "bead": bead, "plateau": plateau}
            | {"axis": None}
            for code, severity, said, bead, plateau in (
                ("not_one_state", "caution", message, NASTY, 1),
                ("not_one_state", "caution", message, UNEXPLAINED, 1),
                ("magnet_log_lag", "info", "The magnets' log is 4.1 s late.", None, None),
                ("hidden_step", "caution", "The force steps at 71 s.", UNEXPLAINED, 2),
            )
        ]

    change_json(folder / "run.json", tell)
    page = Page(write_report(folder))
    start = page.lines.index("The recording")
    told = page.lines[start + 1 : page.lines.index("What was found")]
    assert told[0] == f"warning {NASTY} and {UNEXPLAINED}, plateau 1: {message}"
    assert told[1] == f"caution {UNEXPLAINED}, plateau 2: The force steps at 71 s."
    assert told[2] == "info The magnets' log is 4.1 s late."
    bead = Page(folder / "report" / GOOD)
    row = next(row for row in bead.rows if row[:1] == ["1"] and len(row) > 8)
    assert row[4] == "—empty: the plateau mixes states"


def test_every_effect_has_something_to_do_about_it() -> None:
    for effect in catalogue():
        said = remedy(effect.name)
        assert said.endswith(".")
        assert said[0].islower()
    assert "list shape_memory under [model] effects" in remedy("shape_memory")


def test_index_and_bead_page_say_the_same(folder: Path) -> None:
    index = Page(write_report(folder))
    for bead, name in ((NASTY, GOOD), (UNEXPLAINED, "bead-more0.html")):
        found = finding(folder, bead)
        page = Page(folder / "report" / name)
        for sentence in (found.headline, *found.details, found.note, found.change):
            assert sentence in index.words.replace("\u00a0", " ")
            assert sentence in page.words.replace("\u00a0", " ")


def test_the_terminal_ends_with_the_findings_and_the_report(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change_bead(folder, "more1", verdict="good")
    summary(folder)
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == f"Report: {folder / 'report' / 'index.html'}"
    at = {line.partition(":")[0]: i for i, line in enumerate(lines) if line[:1] != " "}
    found = finding(folder, UNEXPLAINED)
    mine = lines[at[UNEXPLAINED] : at[UNEXPLAINED] + 4]
    assert mine == [
        f"{UNEXPLAINED}: caution. {found.headline}",
        *(f"  {one}" for one in (*found.details, found.note)),
        f"  As the setup states it → to quote: {found.change}.",
    ]
    assert lines.index("Reference bead ref2 jumps by 48 nm and is left out.") < at[UNEXPLAINED]


def test_beads_of_which_the_same_is_said_share_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary(write_run_folder(tmp_path / "run", good=7, plateaus=1))
    shown = capsys.readouterr().out
    assert "more1, more2, more3, more4 and 2 more: good. The recording agrees" in shown
