"""The report's charts: plotly accepts them, and they show the numbers of the run folder."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
from scipy.stats import gamma

from mtpipe.report import write_report
from mtpipe.report.figures_finding import picture
from mtpipe.report.figures_geometry import mean_stderr_nm, plateau_means
from mtpipe.report.figures_run import forces_figure, has_legend
from mtpipe.report.figures_trace import spectrum_figure
from mtpipe.report.folder import read_run_folder
from mtpipe.report.plateau_forces import quoted
from mtpipe.report.plotly_json import DARK, PALETTE, Arrays, outline, with_gaps
from tests.report_folder import write_run_folder
from tests.report_page import Page, resolved, unpacked

GOOD = "bead-b-id-x-b-1-2.html"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = write_run_folder(tmp_path_factory.mktemp("run") / "run")
    write_report(made)
    return made


@pytest.fixture(scope="module")
def pages(folder: Path) -> dict[str, Page]:
    return {path.name: Page(path) for path in sorted((folder / "report").glob("*.html"))}


def test_plotly_accepts_every_figure(pages: dict[str, Page]) -> None:
    seen = 0
    for page in pages.values():
        arrays = unpacked(page.charts["arrays"])
        choices = page.charts.get("choices", {}).values()
        for figures in (page.charts["figures"], *choices):
            for figure in figures.values():
                go.Figure(**resolved(figure, arrays))  # raises on a name plotly does not know
                seen += 1
    assert seen > 40


@pytest.mark.parametrize("ordinates", [1, 3, 40])
def test_bands_of_the_residuals_hold_what_they_say(ordinates: int) -> None:
    bins = 4000
    n = np.full(bins, ordinates)
    ratio = np.random.default_rng(3).gamma(n, 1 / n)
    f = np.arange(1.0, bins + 1)
    table = pd.DataFrame({"frequency_hz": f, "ordinates": n})
    table = table.assign(power_nm2_per_hz=ratio * 7, model_nm2_per_hz=7.0)
    arrays = Arrays()
    made = spectrum_figure(arrays, table, "x")
    data = resolved(made["data"], unpacked(arrays.packed()))
    lower = [trace for trace in data if trace.get("yaxis") == "y2"]
    wide, narrow = (band["y"][[0, -1]] for band in lower[:2])
    np.testing.assert_allclose(wide, gamma.ppf([0.025, 0.975], ordinates, scale=1 / ordinates))
    for (low, high), share in ((wide, 0.95), (narrow, 0.68)):
        inside = np.mean((lower[2]["y"] > low) & (lower[2]["y"] < high))
        assert abs(inside - share) < 4 * np.sqrt(share * (1 - share) / bins)


def test_lines_break_where_time_is_missing() -> None:
    t, y = with_gaps(np.array([0.0, 1, 2, 9, 10]), np.arange(5.0))
    np.testing.assert_array_equal(t, [0, 1, 2, np.nan, 9, 10])
    np.testing.assert_array_equal(y, [0, 1, 2, np.nan, 3, 4])


def test_outline_closes_around_each_stretch() -> None:
    low, high = np.array([0.0, 0, np.nan, 5]), np.array([1.0, 1, np.nan, 6])
    x, y = outline(np.arange(4.0), low, high)
    np.testing.assert_array_equal(x, [0, 1, 1, 0, np.nan, 3, 3])
    np.testing.assert_array_equal(y, [0, 0, 1, 1, np.nan, 5, 6])


def test_what_is_named_is_drawn_before_and_after(pages: dict[str, Page]) -> None:
    charts = pages[GOOD].charts
    spectra = resolved(charts["figures"]["before_after"], unpacked(charts["arrays"]))
    recorded, before, after, ratio_before, ratio_after = spectra["data"][:5]
    np.testing.assert_allclose(after["y"], recorded["y"], rtol=1e-6)
    np.testing.assert_allclose(before["y"], recorded["y"] / 1.1, rtol=1e-6)
    np.testing.assert_allclose(ratio_before["y"], 1.1, rtol=1e-6)
    np.testing.assert_allclose(ratio_before["error_y"]["array"], 0.11, rtol=1e-6)
    np.testing.assert_allclose(ratio_after["y"], 1.0, rtol=1e-6)
    assert [one["yaxis"] for one in spectra["data"][::5]] == ["y", "y2", "y3"]
    maps = charts["figures"]["residuals"]["data"]
    assert [one["z"][0][:2] for one in maps] == [[None, 0.8], [None, 0.0]]
    assert [{z for row in one["z"][1:] for z in row} for one in maps] == [{1.0}, {0.0}]
    assert maps[0]["y"][:2] == ["mean height", "x  0.05 – 1.7 Hz"]
    assert "before_after" not in pages["bead-b10.html"].charts["figures"]


def test_lines_of_maps_do_not_overlap_on_paper(pages: dict[str, Page]) -> None:
    """A figure is a fifth lower there (PRINT_SHRINK), its type of 13 px and its margins are not."""
    seen = 0
    for page in pages.values():
        for name, figure in page.charts["figures"].items():
            made = figure["layout"]
            if figure["data"][0]["type"] == "heatmap" and "b" in made["margin"]:
                room = 0.8 * made["height"] - made["margin"]["t"] - made["margin"]["b"]
                lines = len(figure["data"][0]["y"])
                assert room / lines > 12, (name, lines)
                seen += 1
    assert seen > 0


def test_what_no_effect_explains_is_said_drawn_and_bounded(pages: dict[str, Page]) -> None:
    page = pages["bead-b10.html"]
    assert "Nothing in the catalogue explains it. Between 0.4 and 2.5 Hz along y …" in page.text
    bounds = next(row for row in page.rows if "1.040 ± 0.030" in row)
    assert bounds[bounds.index("1.040 ± 0.030") + 1] == "0.95 – 1.07"
    figure = resolved(page.charts["figures"]["unexplained"], unpacked(page.charts["arrays"]))
    of = {axis: [one for one in figure["data"] if one["xaxis"] == axis] for axis in ("x", "x2")}
    assert [one.get("name") for one in of["x"]] == ["recorded / expected"]
    band, line, points = of["x2"]
    np.testing.assert_allclose(points["y"], line["y"])
    assert line["y"].max() == pytest.approx(1.2, abs=0.01)
    assert band["y"].max() == pytest.approx(1.23, abs=0.01)
    shapes = resolved(page.charts["figures"]["shapes"], unpacked(page.charts["arrays"]))
    assert [one["yaxis"] for one in shapes["data"]] == ["y"] * 3 + ["y2"] * 3
    assert shapes["layout"]["xaxis2"]["title"]["text"] == (
        "x, plateau 1: position / standard deviation"
    )
    np.testing.assert_allclose(
        shapes["data"][2]["error_y"]["arrayminus"], 0.1 * np.geomspace(1, 2, 16)
    )
    assert not {"unexplained", "shapes"} & set(pages[GOOD].charts["figures"])


def test_cross_talk_shows_as_a_slope_of_mean_y_against_mean_z(folder: Path) -> None:
    run = read_run_folder(folder)
    bead = run.beads["bead"][0]
    traces, forces = run.traces.copy(), run.forces
    y = (traces["bead"] == bead) & (traces["axis"] == "y") & (traces["stage"] == "subtracted")
    for row in forces[(forces["bead"] == bead) & (forces["axis"] == "y")].itertuples():
        inside = y & traces["time_s"].between(row.start_s, row.start_s + row.duration_s)
        traces.loc[inside, "mean_nm"] += 0.5 * row.extension_nm
    means = plateau_means(replace(run, traces=traces))[bead, "y"]
    assert np.all(np.diff(means.z_nm) > 0)
    pull = (means.mean_nm - 0.5 * (means.z_nm - means.z_nm[-1])) / means.stderr_nm
    # the fixture's means of stretches scatter by less than thermal motion would
    assert np.abs(pull).max() < 3
    assert means.mean_nm[0] < -5 * means.stderr_nm[0]
    without = plateau_means(run)[bead, "y"]
    assert np.abs(without.mean_nm / without.stderr_nm).max() < 3


def test_standard_errors_of_means_hold_their_scatter() -> None:
    """Means of 400 simulated traces of 300 relaxation times scatter by the error that is drawn."""
    rng = np.random.default_rng(5)
    stiffness, corner_hz, duration_s, step_s = 1e-3, 2.0, 24.0, 0.01
    kept = np.exp(-2 * np.pi * corner_hz * step_s)
    variance = 4.114 / stiffness
    kicks = rng.normal(0, np.sqrt(variance * (1 - kept**2)), (int(duration_s / step_s), 400))
    x = np.empty_like(kicks)
    x[0] = rng.normal(0, np.sqrt(variance), 400)
    for i in range(1, len(x)):
        x[i] = kept * x[i - 1] + kicks[i]
    expected = mean_stderr_nm(4.114, stiffness, corner_hz, duration_s)
    assert x.mean(axis=0).std() == pytest.approx(expected, rel=0.15)  # 4 of its errors


def test_no_figure_has_a_colour_without_a_dark_one(pages: dict[str, Page]) -> None:
    light = {"#56b4e9", "#e69f00", "#ffffff"}  # bright enough on both grounds, or replaced
    for page in pages.values():
        used = set(re.findall(r'"(#[0-9a-f]{6})"', json.dumps(page.charts)))
        assert used - set(DARK) - set(DARK.values()) <= light


def test_the_picture_shows_what_was_found(folder: Path) -> None:
    run = read_run_folder(folder)
    captions = {}
    for bead in run.beads["bead"]:
        made = picture(Arrays(), run, bead)
        assert made is not None
        captions[bead] = made.caption
    assert captions["b10"] == "Motion along x after drift subtraction."
    assert captions["b2"] == "Recorded power along x, divided by the fitted: plateau 0."
    assert captions['../<b id="x">&b 1/2'].startswith("Recorded power along")


@pytest.mark.slow
def test_a_legend_is_spoken_of_only_where_there_is_one(folder: Path, tmp_path: Path) -> None:
    assert "legend" not in Page(folder / "report" / "index.html").text  # one bead has a force
    several = Page(write_report(write_run_folder(tmp_path / "run", good=2, plateaus=2)))
    assert "Select a name in the legend" in several.text
    assert several.charts["figures"]["forces"]["layout"]["showlegend"]
    many = read_run_folder(write_run_folder(tmp_path / "many", good=9, plateaus=1))
    made = forces_figure(Arrays(), quoted(many.forces), list(many.beads["bead"]))
    assert len(made["data"]) > len(PALETTE)
    assert not made["layout"]["showlegend"]
    assert not has_legend([trace["name"] for trace in made["data"]])
