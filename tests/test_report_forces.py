"""The force to quote in the report: one per plateau, with the others beside it by name."""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mtpipe.report import write_report
from mtpipe.report.figures_agreement import agreement_figure
from mtpipe.report.figures_run import forces_figure
from mtpipe.report.folder import read_run_folder
from mtpipe.report.plateau_forces import comparisons, largest_change, quoted
from mtpipe.report.plotly_json import Arrays
from tests.report_folder import CHANGE, NASTY, NO_Z, REFUSED, UNEXPLAINED, write_run_folder
from tests.report_page import Page, resolved, unpacked

GOOD = "bead-b-id-x-b-1-2.html"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = write_run_folder(tmp_path_factory.mktemp("run") / "run", good=1)
    write_report(made)
    return made


def forces_of(page: Page) -> dict[str, dict[str, str]]:
    """The table of forces: cells by heading, by plateau."""
    start = next(i for i, row in enumerate(page.rows) if "Force to quotepN" in row)
    head = page.rows[start]
    rows = takewhile(lambda row: row[0].isdigit(), page.rows[start + 1 :])
    return {row[0]: dict(zip(head, row, strict=True)) for row in rows}


def column(forces: pd.DataFrame, bead: str, axis: str, name: str) -> np.ndarray:
    """A column of `forces` over the plateaus of a bead."""
    mine = forces[(forces["bead"] == bead) & (forces["axis"] == axis)]
    return mine.sort_values("plateau")[name].to_numpy()


def test_a_plateau_has_one_force_with_the_others_beside_it(folder: Path) -> None:
    forces = pd.read_parquet(folder / "forces.parquet")
    x, y = forces[(forces["bead"] == NASTY) & (forces["plateau"] == 1)].head(2).itertuples()
    shown = forces_of(Page(folder / "report" / GOOD))
    assert list(shown) == ["0", "1", "2", "3"]
    one = shown["1"]
    assert one["Force to quotepN"] == f"{x.force_pN:.3f} ± {x.force_stderr_pN:.3f}"
    assert one["From"] == "with the causes found"
    assert one["As configuredpN"].startswith(f"{x.force_configured_pN:.3f} ±")
    assert one["With the causes foundpN"].startswith(f"{x.force_named_pN:.3f} ±")
    assert one["x alonepN"].startswith(f"{x.force_axis_pN:.3f} ±")
    assert one["y alonepN"].startswith(f"{y.force_axis_pN:.3f} ±")
    apart = (x.force_axis_pN - y.force_axis_pN) / np.hypot(
        x.force_axis_stderr_pN, y.force_axis_stderr_pN
    )
    assert one["x − yσ"] == f"{apart:+.1f}".replace("-", "−")


def test_columns_of_forces_that_nobody_has_are_left_out(folder: Path) -> None:
    unexplained = forces_of(Page(folder / "report" / "bead-more0.html"))["0"]
    assert "As configuredpN" in unexplained
    assert "With the causes foundpN" not in unexplained
    no_z = forces_of(Page(folder / "report" / "bead-b2.html"))["0"]
    assert "As configuredpN" not in no_z
    assert no_z["Force to quotepN"] == "—empty: there is no extension"


def test_a_force_is_drawn_and_counted_once_per_plateau(folder: Path) -> None:
    run = read_run_folder(folder)
    given = quoted(run.forces)
    assert not given.duplicated(["bead", "plateau"]).any()
    assert set(given["bead"]) == {NASTY, UNEXPLAINED}
    arrays = Arrays()
    made = forces_figure(arrays, quoted(run.forces), [NASTY, NO_Z, REFUSED, UNEXPLAINED])
    data = resolved(made["data"], unpacked(arrays.packed()))
    assert len(data) == 2
    assert [len(trace["y"]) for trace in data] == [4, 4]
    assert all(sign.endswith("-open") for sign in data[1]["marker"]["symbol"])
    assert not any(sign.endswith("-open") for sign in data[0]["marker"]["symbol"])


def test_the_largest_change_is_from_the_setup_as_configured(folder: Path) -> None:
    forces = read_run_folder(folder).forces
    mine = forces[forces["bead"] == UNEXPLAINED].copy()
    first = mine["plateau"] == 2
    mine.loc[first, "force_configured_pN"] = 4 * mine.loc[first, "force_pN"]
    change = largest_change(mine)
    assert change is not None
    assert (change.plateau, change.ratio) == (2, pytest.approx(0.25))
    named = largest_change(forces[forces["bead"] == NASTY])
    assert named is not None
    assert named.ratio == pytest.approx(CHANGE)
    assert largest_change(forces[forces["bead"] == NO_Z]) is None


def test_x_and_y_are_compared_with_the_force_to_quote(folder: Path) -> None:
    forces = read_run_folder(folder).forces
    compared = comparisons(forces[forces["bead"] == NASTY])
    given = column(forces, NASTY, "x", "force_pN")
    np.testing.assert_allclose([one.given for one in compared], given)
    arrays = Arrays()
    figure = resolved(agreement_figure(arrays, compared)["data"], unpacked(arrays.packed()))
    assert [trace["name"] for trace in figure] == ["x alone", "y alone"]
    for trace, axis in zip(figure, "xy", strict=True):
        alone = column(forces, NASTY, axis, "force_axis_pN")
        np.testing.assert_allclose(trace["y"], alone / given, rtol=1e-5)
    assert agreement_figure(arrays, [])["data"] == []


def test_captions_say_which_posterior_is_shown(folder: Path) -> None:
    captions = Page(folder / "report" / GOOD).charts["captions"]
    joint = "From the posterior of the joint fit of all the bead's spectra: stiffness and friction"
    assert captions["1/y"]["posterior"].startswith(
        f"{joint} of this trace, and the force that x and y share. C"
    )
    assert captions["2/y"]["posterior"].startswith("Posterior of this trace alone. ")
    assert captions["1/y"]["spectrum"].startswith("Force from y alone: ")


@pytest.mark.slow
def test_what_is_not_identified_says_with_what(tmp_path: Path) -> None:
    folder = write_run_folder(tmp_path / "run", plateaus=1)
    forces = pd.read_parquet(folder / "forces.parquet")
    mine = forces["bead"] == NASTY
    row = mine & (forces["axis"] == "x")
    forces.loc[mine, [f"force{part}_pN" for part in ("", "_low", "_high")]] = np.nan
    forces.loc[row, [f"force_axis{part}_pN" for part in ("", "_low", "_high")]] = np.nan
    forces.loc[row, "status"] = "not_identified"
    for tied, why in (
        ("stiffness;friction;noise", "the data determine only stiffness, friction and noise"),
        ("stiffness", "the data do not determine it"),
    ):
        forces.loc[row, "tied_to"] = tied
        forces.to_parquet(folder / "forces.parquet")
        shown = forces_of(Page(write_report(folder).with_name(GOOD)))["0"]
        assert shown["Force to quotepN"].startswith(f"—empty: {why}")
        assert shown["x alonepN"].startswith(f"—empty: {why}")


@pytest.mark.slow
def test_forces_by_other_methods_stand_beside_and_change_nothing(tmp_path: Path) -> None:
    folder = write_run_folder(tmp_path / "run", plateaus=2)
    before = Page(write_report(folder).with_name(GOOD))
    forces = pd.read_parquet(folder / "forces.parquet")
    mine = forces[(forces["bead"] == NASTY) & (forces["axis"] != "z")]
    allan = mine.assign(method="allan", force_axis_pN=5.0, force_axis_stderr_pN=0.5)
    allan = allan.assign(force_axis_low_pN=4.5, force_axis_high_pN=5.5)
    failed = mine.assign(method="arctangent", force_axis_pN=np.nan, refusal="frames are lost")
    failed = failed.assign(force_axis_low_pN=np.nan, force_axis_high_pN=np.nan)
    pd.concat([forces, allan, failed]).to_parquet(folder / "forces.parquet")
    after = Page(write_report(folder).with_name(GOOD))
    table = [row for row in after.rows if row not in before.rows]
    assert table[0][-2:] == ["allanpN", "arctangentpN"]
    assert [row[:2] for row in table[1:]] == [["0", "x"], ["0", "y"], ["1", "x"], ["1", "y"]]
    assert {row[-2] for row in table[1:]} == {"5.0 ± 0.5"}
    assert {row[-1] for row in table[1:]} == {"—empty: frames are lost"}
    assert [row for row in after.rows if row not in table] == before.rows
    assert after.charts == before.charts
