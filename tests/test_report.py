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
from mtpipe.report.figures_trace import spectrum_figure
from mtpipe.report.pages import page_names
from mtpipe.report.plotly_json import Arrays, outline, with_gaps
from tests.report_folder import NASTY, NO_Z, REFUSED, write_run_folder

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


@pytest.mark.parametrize("name", ["run.json", "beads.parquet", "details/traces.parquet"])
def test_a_missing_file_is_named(tmp_path: Path, name: str) -> None:
    folder = write_run_folder(tmp_path / "run", plateaus=1)
    (folder / name).unlink()
    with pytest.raises(MtpipeError, match=re.escape(name)):
        write_report(folder)


def test_a_run_without_drift_posterior_or_curve(tmp_path: Path) -> None:
    folder = write_run_folder(tmp_path / "run", plateaus=2)
    for name in ("drift", "references", "posteriors", "force_extension"):
        path = folder / "details" / f"{name}.parquet"
        pd.DataFrame(columns=pd.read_parquet(path).columns).to_parquet(path)
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


def test_beads_of_the_fixture_cover_the_verdicts(folder: Path) -> None:
    beads = pd.read_parquet(folder / "beads.parquet").set_index("bead")["verdict"]
    assert dict(beads) == {NASTY: "good", NO_Z: "caution", REFUSED: "refused"}
