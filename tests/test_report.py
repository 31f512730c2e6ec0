"""The report's pages, without a browser: text of the tables, escaping, charts, refusals."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
from scipy.stats import gamma

from mtpipe.errors import MtpipeError
from mtpipe.report import write_report
from mtpipe.report.figures_agreement import agreement_figure
from mtpipe.report.figures_trace import spectrum_figure
from mtpipe.report.folder import COLUMNS, read_run_folder
from mtpipe.report.pages import page_names
from mtpipe.report.plateau_forces import comparisons, drawn_forces
from mtpipe.report.plotly_json import Arrays, outline, with_gaps
from tests.report_folder import LEFT_OUT, NASTY, NO_Z, REFUSED, write_run_folder

GOOD = "bead-b-id-x-b-1-2.html"
DESCRIPTION = Path(__file__).parents[1] / "docs" / "run-folder.md"
GOLDEN = Path(__file__).with_name("test_report_beads.txt")


class Page(HTMLParser):
    """Tables as rows of text, links and sources, visible text, and the charts of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.loads: list[str] = []
        self.text = self.charts_json = ""
        self._inside: str | None = None
        self.feed(path.read_text(encoding="utf-8"))
        self.charts: dict[str, Any] = json.loads(self.charts_json)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.loads += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
        self._inside = tag if tag in ("td", "th", "script") else self._inside

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th", "script"):
            self._inside = None

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            self.charts_json += data
            return
        self.text += data
        if self._inside in ("td", "th"):
            self.rows[-1][-1] = " ".join((self.rows[-1][-1] + data).split())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = write_run_folder(tmp_path_factory.mktemp("run") / "run")
    write_report(made)
    return made


@pytest.fixture(scope="module")
def pages(folder: Path) -> dict[str, Page]:
    return {path.name: Page(path) for path in sorted((folder / "report").glob("*.html"))}


def resolved(part: Any, arrays: list[np.ndarray]) -> Any:
    """What report.js does: put the page's arrays where the figures say."""
    if isinstance(part, list):
        return [resolved(one, arrays) for one in part]
    if not isinstance(part, dict):
        return part
    if set(part) == {"array"} and isinstance(part["array"], int):
        return arrays[part["array"]]
    return {key: resolved(value, arrays) for key, value in part.items()}


def unpacked(packed: list[str]) -> list[np.ndarray]:
    return [np.frombuffer(base64.b64decode(one), "<f4") for one in packed]


def test_table_of_beads_reads_as_the_golden_file(pages: dict[str, Page]) -> None:
    rows = pages["index.html"].rows[:4]
    assert [" | ".join(row) for row in rows] == GOLDEN.read_text(encoding="utf-8").splitlines()


def test_every_bead_has_a_page_that_the_index_links(folder: Path, pages: dict[str, Page]) -> None:
    linked = {name for name in pages["index.html"].loads if name.startswith("bead-")}
    assert linked == set(pages) - {"index.html"}
    assert len(linked) == 3


def test_names_are_escaped(folder: Path) -> None:
    for path in (folder / "report").glob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert "<b id" not in text
        assert "<2>" not in text
    assert "../&lt;b id=&#34;x&#34;&gt;&amp;b 1/2" in (folder / "report/index.html").read_text()


def test_file_names_are_safe_and_different() -> None:
    beads = ["../x", "b 1/2", "b-1-2", "B 1 2", "", "ü", "a" * 300, "index"]
    names = list(page_names(beads).values())
    assert all(re.fullmatch(r"bead-[A-Za-z0-9_-]{1,70}\.html", name) for name in names)
    assert len({name.casefold() for name in names}) == len(beads)


def test_nothing_is_loaded_from_a_network(folder: Path, pages: dict[str, Page]) -> None:
    for page in pages.values():
        assert page.loads
        for load in page.loads:
            there = (folder / "report" / load.split("#")[0]).exists()
            assert load == "data:," or there, load
    for own in ("report.css", "report.js"):
        text = (folder / "report" / own).read_text()
        assert not re.search(r"//[a-z]|url\(|@import", text.replace("// ", ""))


def test_no_page_shows_a_number_that_is_none(pages: dict[str, Page]) -> None:
    for name, page in pages.items():
        assert not re.search(r"\b(nan|none|null|inf|undefined)\b", page.text, re.IGNORECASE), name


def test_an_empty_value_has_its_reason(pages: dict[str, Page]) -> None:
    empty = [
        cell for page in pages.values() for row in page.rows for cell in row if cell[:1] == "—"
    ]
    assert empty
    assert all(re.fullmatch("—empty: .{10,}", cell) for cell in empty)


def test_refusals_and_flags_are_said_in_words(pages: dict[str, Page]) -> None:
    assert "does not respond to the force: it is stuck" in pages["bead-b10.html"].text
    good = pages["bead-b-id-x-b-1-2.html"].text
    assert "The corner is 0.7 of the Nyquist frequency." in good
    assert "posterior not converged" in good
    assert "the fit ended at a physical limit" in good


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


def test_the_same_run_gives_the_same_report(folder: Path) -> None:
    def content() -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (folder / "report").iterdir()}

    before = content()
    steps: list[tuple[int, int]] = []
    write_report(folder, progress=lambda done, total: steps.append((done, total)))
    assert content() == before
    assert steps == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_a_damaged_run_leaves_the_report_as_it_was(tmp_path: Path) -> None:
    folder = write_run_folder(tmp_path / "run", plateaus=1)
    index = write_report(folder)
    before = index.read_bytes()
    table = pd.read_parquet(folder / "forces.parquet")
    table.drop(columns="noise_low_nm").to_parquet(folder / "forces.parquet")
    with pytest.raises(MtpipeError, match=r"forces\.parquet: lacks the column noise_low_nm\."):
        write_report(folder)
    assert index.read_bytes() == before


@pytest.mark.parametrize(
    "name",
    [
        "run.json",
        "beads.parquet",
        "details/traces.parquet",
        "details/before_after.json",
        "details/unexplained.json",
    ],
)
def test_a_missing_file_is_named(tmp_path: Path, name: str) -> None:
    folder = write_run_folder(tmp_path / "run", plateaus=1)
    (folder / name).unlink()
    with pytest.raises(MtpipeError, match=re.escape(name)):
        write_report(folder)


def test_a_run_without_drift_posterior_or_curve(tmp_path: Path) -> None:
    folder = write_run_folder(tmp_path / "run", plateaus=2)
    for name in ("drift", "references", "posteriors", "force_extension"):
        path = folder / "details" / f"{name}.parquet"
        pd.read_parquet(path).iloc[:0].astype(object).to_parquet(path)
    run = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(run | {"drift": None, "notices": []}))
    page = Page(write_report(folder))
    assert "Nothing was subtracted" in page.text
    assert "The recording has no reference bead" in page.text
    assert "No warnings and no cautions about" in page.text


def test_a_limit_is_shown_as_one(tmp_path: Path) -> None:
    folder = write_run_folder(tmp_path / "run", good=1, plateaus=2)
    page = Page(write_report(folder).with_name("bead-more0.html"))
    moduli = [row[3] for row in page.rows[1:4]]
    assert moduli == [*["—empty: this model is inextensible"] * 2, "> 880"]


def test_the_fixture_writes_the_columns_the_report_reads(folder: Path) -> None:
    for name, columns in COLUMNS.items():
        assert set(pd.read_parquet(folder / name).columns) == set(columns), name


def test_every_column_is_described() -> None:
    text = DESCRIPTION.read_text(encoding="utf-8")
    for name, columns in COLUMNS.items():
        mark = f"| `{Path(name).name}`" if name.startswith("details/") else f"## `{name}`"
        section = text.split(mark)[1].split("\n" if mark[0] == "|" else "\n## ")[0]
        named = set(re.findall(r"\w+", " ".join(re.findall("`([^`]+)`", section))))
        for column in columns:  # an estimate's first column stands for the four
            first = re.sub("_(stderr|low|high)(?=_)", "", column)
            assert {column, first} & named or f"(+ `_{column.rsplit('_')[-1]}`)" in section, column


def lateral(page: Page, plateau: int) -> list[list[str]]:
    """Rows x and y of a plateau in the table of forces, from the axis on."""
    start = next(i for i, row in enumerate(page.rows) if row[:1] == ["Plateau"]) + 1
    x, y = page.rows[start + 3 * plateau : start + 3 * plateau + 2]
    return [x[3:], y]


def test_a_shared_force_stands_once_with_x_and_y_beside_it(
    folder: Path, pages: dict[str, Page]
) -> None:
    forces = pd.read_parquet(folder / "forces.parquet")
    x, y = forces[(forces["bead"] == NASTY) & (forces["plateau"] == 1)].head(2).itertuples()
    assert x.force_pN == y.force_pN
    shown_x, shown_y = lateral(pages[GOOD], 1)
    assert shown_x[:2] == ["x", f"{x.force_pN:.3f} ± {x.force_stderr_pN:.3f}x and y share it"]
    assert shown_x[2].startswith(f"{x.force_alone_pN:.3f} ±")
    apart = (x.force_alone_pN - y.force_alone_pN) / np.hypot(
        x.force_alone_stderr_pN, y.force_alone_stderr_pN
    )
    assert shown_x[3] == f"{apart:+.1f}".replace("-", "−")
    # y has neither cell, and goes on with its own force and its stiffness
    assert shown_y[0] == "y"
    assert shown_y[1].startswith(f"{y.force_alone_pN:.3f} ±")
    assert shown_y[2].startswith(f"{1e3 * y.stiffness_pN_per_nm:.3f}"[:4])


def test_a_force_that_is_not_shared_stands_in_each_row(pages: dict[str, Page]) -> None:
    x, y = lateral(pages[GOOD], LEFT_OUT[1])
    assert not any("share" in cell for cell in (*x, *y))
    assert len(x) == len(y) + 1  # the difference alone is common to both


def test_a_shared_force_is_drawn_once(folder: Path) -> None:
    drawn = drawn_forces(read_run_folder(folder).forces)
    mine = drawn[drawn["bead"] == NASTY]
    assert list(mine["source"]) == ["x and y", "x and y", "x", "y", "x and y"]
    assert list(mine["plateau"]) == [0, 1, 2, 2, 3]


def column(forces: pd.DataFrame, bead: str, axis: str, name: str) -> np.ndarray:
    """A column of `forces` over the plateaus of a bead."""
    mine = forces[(forces["bead"] == bead) & (forces["axis"] == axis)]
    return mine.sort_values("plateau")[name].to_numpy()


def test_x_and_y_are_compared_with_the_force_given(tmp_path: Path) -> None:
    forces = read_run_folder(write_run_folder(tmp_path / "run", good=1)).forces
    shared = comparisons(forces[forces["bead"] == NASTY])
    # in plateau 2 y is no part of the joint fit: the force given is that of x
    given = column(forces, NASTY, "x", "force_pN")
    np.testing.assert_allclose([one.given for one in shared], given)
    apart = comparisons(forces[forces["bead"] == "more0"])
    x, y = (column(forces, "more0", axis, "force_pN") for axis in "xy")
    # the mean of both, weighted by errors that are in proportion to the forces
    np.testing.assert_allclose([one.given for one in apart], (1 / x + 1 / y) / (x**-2 + y**-2))
    arrays = Arrays()
    figure = resolved(agreement_figure(arrays, shared)["data"], unpacked(arrays.packed()))
    assert [trace["name"] for trace in figure] == ["x by itself", "y by itself"]
    for trace, axis in zip(figure, "xy", strict=True):
        alone = column(forces, NASTY, axis, "force_alone_pN")
        np.testing.assert_allclose(trace["y"], alone / given, rtol=1e-5)
    assert agreement_figure(arrays, [])["data"] == []


def test_the_page_says_where_the_forces_come_from(pages: dict[str, Page]) -> None:
    good = " ".join(pages[GOOD].text.split())
    assert "One joint fit of 7 spectra gives the forces: x and y of a plateau share one" in good
    assert "The friction is the one expected from radius" in good
    assert "Plateau 2, y contradicts the others and was fitted by itself." in good
    assert re.search(r"1391 ± 17 nm\s*setup: 1400 ± 30 nm", good)
    no_z = " ".join(pages["bead-b2.html"].text.split())
    assert "Each spectrum was fitted by itself (friction expected from the setup)." in no_z
    assert "A joint fit needs the extension, which is not known." in no_z
    assert "fitted by itself" not in pages["bead-b10.html"].text


def test_noise_by_spectra_stands_beside_noise_by_images(pages: dict[str, Page]) -> None:
    good = " ".join(pages[GOOD].text.split())
    assert "Tracking noise: x 1 nm by its images, 1.21 ± 0.07 nm by its spectra; y 1.1 nm" in good
    assert "; z 3.2 nm by its images, not told by its spectra." in good
    assert "by its images" not in pages["bead-b2.html"].text


def test_captions_say_which_posterior_is_shown(pages: dict[str, Page]) -> None:
    captions = pages[GOOD].charts["captions"]
    joint = "Joint posterior of the bead's series, seen from this trace: its stiffness and friction"
    assert captions["1/y"]["posterior"].startswith(f"{joint}, and the force that x and y share. C")
    assert captions["2/x"]["posterior"].startswith(f"{joint}. ")
    assert captions["2/y"]["posterior"].startswith("Posterior of this trace by itself. ")
    assert "common to x and y; y by itself tells" in captions["1/y"]["spectrum"]
    assert "common" not in captions["2/x"]["spectrum"]


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
    assert "what was tried does not explain it" in " ".join(page.text.split())
    assert "Nothing in the catalogue explains it. Between 0.4 and 2.5 Hz along y …" in page.text
    assert ["0", "3.000", "0.98", "1.04 ± 0.03", "0.95 – 1.07"] in page.rows
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


def test_what_is_not_identified_says_with_what(tmp_path: Path) -> None:
    folder = write_run_folder(tmp_path / "run", plateaus=1)
    forces = pd.read_parquet(folder / "forces.parquet")
    row = (forces["bead"] == NASTY) & (forces["axis"] == "x")
    forces.loc[row, ["force_pN", "force_low_pN", "force_high_pN"]] = np.nan
    forces.loc[row, "status"] = "not_identified"
    for tied, why in (
        ("stiffness;friction;noise", "the data tell only stiffness, friction and noise together"),
        ("stiffness", "the data do not determine it"),
    ):
        forces.loc[row, "tied_to"] = tied
        forces.to_parquet(folder / "forces.parquet")
        assert lateral(Page(write_report(folder).with_name(GOOD)), 0)[0][1] == f"—empty: {why}"


def test_forces_by_other_methods_stand_beside_and_change_nothing(tmp_path: Path) -> None:
    folder = write_run_folder(tmp_path / "run", plateaus=2)
    before = Page(write_report(folder).with_name(GOOD))
    forces = pd.read_parquet(folder / "forces.parquet")
    mine = forces[(forces["bead"] == NASTY) & (forces["axis"] != "z")]
    allan = mine.assign(method="allan", force_pN=5.0, force_stderr_pN=0.5)
    failed = mine.assign(method="arctangent", force_pN=np.nan, refusal="frames are lost")
    failed = failed.assign(force_low_pN=np.nan, force_high_pN=np.nan)
    allan = allan.assign(force_low_pN=4.5, force_high_pN=5.5)
    pd.concat([forces, allan, failed]).to_parquet(folder / "forces.parquet")
    after = Page(write_report(folder).with_name(GOOD))
    table = [row for row in after.rows if row not in before.rows]
    assert table[0][-2:] == ["allanpN", "arctangentpN"]
    assert [row[:2] for row in table[1:]] == [["0", "x"], ["0", "y"], ["1", "x"], ["1", "y"]]
    assert {row[-2] for row in table[1:]} == {"5.0 ± 0.5"}
    assert {row[-1] for row in table[1:]} == {"—empty: frames are lost"}
    assert [row for row in after.rows if row not in table] == before.rows
    assert after.charts == before.charts


def test_beads_of_the_fixture_cover_the_verdicts(folder: Path) -> None:
    beads = pd.read_parquet(folder / "beads.parquet").set_index("bead")["verdict"]
    assert dict(beads) == {NASTY: "good", NO_Z: "caution", REFUSED: "refused"}
