"""The report's charts: plotly accepts them, and they show the numbers of the run folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
from scipy.stats import gamma

from mtpipe.report import write_report
from mtpipe.report.figures_trace import spectrum_figure
from mtpipe.report.plotly_json import Arrays, outline, with_gaps
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


def test_what_no_effect_explains_is_said_drawn_and_bounded(pages: dict[str, Page]) -> None:
    page = pages["bead-b10.html"]
    assert "Nothing in the catalogue explains it. Between 0.4 and 2.5 Hz along y …" in page.text
    bounds = next(row for row in page.rows if "1.04 ± 0.03" in row)
    assert bounds[bounds.index("1.04 ± 0.03") + 1] == "0.95 – 1.07"
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
