"""The report in a real browser: opens from disk, draws, sorts, chooses, prints."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

import pytest

from mtpipe.report import write_report
from mtpipe.report.batch_page import batch_page
from mtpipe.report.marks import MARKS, Mark, read_marks
from tests.report_folder import NASTY, write_run_folder

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium on this machine")
QUIET = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
)
# Charts are drawn as they come into sight; printing draws all of them.
DRAW_ALL = """() => {
    for (const place of document.querySelectorAll("[data-figure]")) drawFirst(place);
}"""
DRAWN = """() => [...document.querySelectorAll("[data-figure]")]
    .every(place => place.querySelector(".main-svg"))"""
GOOD = "bead-b-id-x-b-1-2.html"
Open = Callable[..., Any]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(write_run_folder(tmp_path_factory.mktemp("run") / "a run")).parent


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=list(QUIET))
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def complaints() -> list[str]:
    """What went wrong on any page; empty at the end of every test."""
    return []


@pytest.fixture(scope="module")
def opened(browser: Any, report: Path, complaints: list[str]) -> Open:
    """Open a page, once for all tests, with its charts drawn."""

    @cache
    def opened(name: str) -> Any:
        page = new_page(browser, complaints, width=1280)
        page.goto((report / name).as_uri())
        page.evaluate(DRAW_ALL)
        page.wait_for_function(DRAWN)
        return page

    return opened


@pytest.fixture(autouse=True)
def _nothing_goes_wrong(complaints: list[str]) -> Iterator[None]:
    yield
    assert complaints == []


def new_page(browser: Any, complaints: list[str], *, width: int, **options: Any) -> Any:
    page = browser.new_page(viewport={"width": width, "height": 800}, **options)
    page.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("requestfailed", lambda request: complaints.append(f"failed: {request.url}"))
    page.on("request", lambda request: complaints.extend(_outside(request.url)))
    return page


def _outside(url: str) -> list[str]:
    return [] if url.startswith(("file:", "data:", "blob:")) else [f"network: {url}"]


def names(page: Any) -> list[str]:
    return [text.strip() for text in page.locator("table.beads tbody th").all_inner_texts()]


def test_beads_sort_by_click_and_by_key(opened: Open) -> None:
    page = opened("index.html")
    heads = page.locator("table.beads thead th")
    nasty = names(page)[0]
    assert names(page)[1:] == ["b2", "b10"]
    heads.nth(0).get_by_role("button").click()
    assert heads.nth(0).get_attribute("aria-sort") == "ascending"
    assert heads.nth(1).get_attribute("aria-sort") is None
    assert names(page) == [nasty, "b2", "b10"]
    page.keyboard.press("Enter")
    assert heads.nth(0).get_attribute("aria-sort") == "descending"
    assert names(page) == ["b10", "b2", nasty]
    for _ in range(2):  # a bead without the value stays last in both directions
        heads.nth(6).get_by_role("button").click()
        assert names(page)[2] == "b10"


def shown(page: Any) -> list[str]:
    """Names of the beads whose findings are to be seen; the table shows the same."""
    seen = [article.get_attribute("data-bead") for article in
            page.locator("article[data-bead]:visible").all()]  # fmt: skip
    assert page.locator("table.beads tbody tr:visible").count() == len(seen)
    return seen


def test_beads_are_searched_and_filtered(opened: Open) -> None:
    page = opened("index.html")
    search, said = page.get_by_role("searchbox"), page.locator("#shown")
    assert len(shown(page)) == 3
    assert said.inner_text() == ""
    search.fill("stuck SURFACE")  # words of a finding, in any order and case
    assert shown(page) == ["b10"]
    assert said.inner_text() == "1 of 3 beads shown"
    search.fill("nothing like it")
    assert shown(page) == []
    search.fill("")
    page.get_by_role("checkbox", name="refused").uncheck()
    assert "b10" not in shown(page)
    assert len(shown(page)) == 2
    search.fill("b1")  # the nasty name has a "b 1" but no "b1"
    assert shown(page) == []
    search.fill("")
    page.get_by_role("checkbox", name="refused").check()
    assert len(shown(page)) == 3


def test_tables_are_there_to_be_read_by_other_programs(opened: Open, report: Path) -> None:
    links = opened("index.html").locator(".files a").evaluate_all("links => links.map(a => a.href)")
    assert {link.rsplit("/", 1)[1] for link in links} >= {"forces.csv", "beads.csv"}
    assert all(Path(unquote(urlparse(link).path)).exists() for link in links)


def test_a_table_and_a_figure_are_saved(opened: Open) -> None:
    page = opened("index.html")
    with page.expect_download() as table:
        page.locator("[aria-labelledby=beads] button.save").click()
    assert table.value.suggested_filename == "beads-in-numbers.csv"
    lines = Path(table.value.path()).read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith('"Bead","Verdict","Force to quote pN"')
    assert len(lines) == 1 + page.locator("table.beads tbody tr").count()
    with page.expect_download() as figure:
        page.locator("[data-figure=forces] .modebar-btn[data-title^='Save as SVG']").click()
    assert figure.value.suggested_filename == "forces.svg"
    assert Path(figure.value.path()).read_text(encoding="utf-8").startswith("<svg")


def test_marks_are_saved_as_the_program_reads_them(opened: Open, tmp_path: Path) -> None:
    page = opened("index.html")
    page.locator("#left-out ~ details summary").click()
    form = page.locator("#mark")
    form.locator("[name=bead]").select_option(NASTY)
    form.locator("[name=reason]").fill('it "jumped" ü')
    form.locator("button").click()
    form.locator("[name=plateau]").select_option("stretch")
    form.locator("[name=begin]").fill("3")
    form.locator("[name=end]").fill("4.25")
    form.locator("[name=reason]").fill("focus")
    form.locator("button").click()
    form.locator("[name=plateau]").select_option("2")
    form.locator("[name=reason]").fill("taken back")
    form.locator("button").click()
    page.locator("#marked button").nth(2).click()
    with page.expect_download() as saved:
        page.locator("#save-marks").click()
    assert saved.value.suggested_filename == MARKS
    saved.value.save_as(tmp_path / MARKS)
    assert read_marks(tmp_path) == (
        Mark(NASTY, 'it "jumped" ü'),
        Mark(NASTY, "focus", from_s=3.0, to_s=4.25),
    )


def test_the_finding_comes_before_all_else(opened: Open) -> None:
    """At the top of index and bead page: verdict, sentence, forces and the picture."""
    for name in ("index.html", GOOD):
        page = opened(name)
        page.set_viewport_size({"width": 1280, "height": 800})
        for part in (".verdict", ".headline", ".force", ".picture .main-svg"):
            box = page.locator(part).first.bounding_box()
            assert box["y"] + box["height"] < 800, (name, part)
    page = opened(GOOD)
    order = ["#simulation", "[data-figure=before_after]", "[data-figure=crosscheck]", "table"]
    tops = [page.locator(part).first.evaluate("e => e.getBoundingClientRect().top")
            for part in order]  # fmt: skip
    assert tops == sorted(tops)


def test_hover_shows_the_values(opened: Open) -> None:
    page = opened("index.html")
    page.locator("[data-figure=forces] .points path").first.hover(force=True)
    page.wait_for_function("document.querySelector('.hoverlayer .hovertext') !== null")
    shown = page.locator("[data-figure=forces] .hoverlayer").evaluate("layer => layer.textContent")
    # the name of the bead stands there as it is, not as HTML
    assert '../<b id="x">&b 1/2' in shown
    assert "pN" in shown


def test_plateau_and_axis_are_chosen(opened: Open) -> None:
    page = opened(GOOD)
    spectrum = page.locator("[data-choice=spectrum]")
    title = page.locator(".chosen").first
    point = "place => place.data[2].y[5]"
    seen = [spectrum.evaluate(point)]
    assert title.inner_text() == "plateau 0, x"
    page.get_by_label("next plateau").click()
    seen.append(spectrum.evaluate(point))
    page.get_by_role("radio", name="y").check()
    assert title.inner_text() == "plateau 1, y"
    seen.append(spectrum.evaluate(point))
    page.locator("a[data-key='3/z']").click()
    assert title.inner_text() == "plateau 3, z"
    seen.append(spectrum.evaluate(point))
    assert len(set(seen)) == 4
    assert page.get_by_label("next plateau").is_disabled()
    assert "Not converged" in page.locator("[data-caption=posterior]").inner_text()


def test_printing_gives_charts_the_width_of_the_paper(opened: Open) -> None:
    page = opened(GOOD)
    # a window of another width first: plotly then forgets the height it was given
    page.set_viewport_size({"width": 1000, "height": 800})
    page.wait_for_function("document.querySelector('[data-figure=traces]')._fullLayout.width < 990")
    sizes = """() => [...document.querySelectorAll(".js-plotly-plot")]
        .map(place => place.querySelector(".main-svg").getBoundingClientRect())
        .map(svg => [Math.round(svg.width), Math.round(svg.height)])"""
    before = page.evaluate(sizes)
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    printed = page.evaluate(sizes)
    # the picture of the finding stands beside its words, the others fill the paper
    assert [width for width, _ in printed] == [320, *[680] * (len(printed) - 1)]
    assert [h for _, h in printed[1:]] == [round(0.8 * height) for _, height in before[1:]]
    assert printed[0][1] == before[0][1]
    assert page.locator("details:not([open])").count() == 0
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(sizes) == before
    assert page.locator("details[open]").count() == 0


def test_labels_on_paper_lie_on_no_other(browser: Any, report: Path, complaints: list[str]) -> None:
    page = new_page(browser, complaints, width=1280)
    page.goto((report / GOOD).as_uri())
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    page.wait_for_function(DRAWN)
    boxes = "all => all.map(e => e.getBoundingClientRect()).map(b => [b.top, b.bottom])"
    for name in ("residuals", "crosscheck"):
        rows = sorted(page.locator(f"[data-figure={name}] .ytick text").evaluate_all(boxes))
        assert len(rows) > 5
        # a line of type has some room above and below its letters
        overlaps = [above[1] - below[0] for above, below in itertools.pairwise(rows)]
        assert max(overlaps) < 1, name
    # numbers and title of a panel stand beside the one before it
    compared = page.locator("[data-choice=crosscheck]")
    ends = compared.evaluate(
        "place => ['xaxis', 'xaxis2'].map(name => place._fullLayout[name])"
        ".map(axis => place.getBoundingClientRect().left + axis._offset + axis._length)"
    )
    for end, title in zip(ends, (".y2title", ".y3title"), strict=True):
        assert compared.locator(title).bounding_box()["x"] > end
    page.close()


def test_what_only_a_screen_can_use_is_not_printed(opened: Open) -> None:
    page = opened("index.html")
    page.emulate_media(media="print")
    for action in ("Leave something out", "Select a name in the legend"):
        assert not page.get_by_text(action).is_visible()
    # the line that opens a list is not parted from it
    breaks = page.locator("summary").evaluate_all(
        "all => all.map(e => getComputedStyle(e).breakAfter)"
    )
    assert set(breaks) == {"avoid"}
    page.emulate_media(media="screen")
    assert page.get_by_text("Leave something out").is_visible()


def test_the_table_of_fits_fits_the_window(opened: Open) -> None:
    page = opened(GOOD)
    page.set_viewport_size({"width": 1280, "height": 800})
    table = page.locator(".scroll.wide")
    assert table.evaluate("place => place.scrollWidth - place.clientWidth") == 0
    # the columns stay in line although a cell spans the rows of a plateau
    lefts = (
        "cells => [...new Set(cells.map(cell => Math.round(cell.getBoundingClientRect().left)))]"
    )
    assert len(page.locator("table.fits tbody th[scope=row]").evaluate_all(lefts)) == 1
    assert len(page.locator("table.fits tbody td.status").evaluate_all(lefts)) == 1


def test_a_refused_trace_is_said_to_be(opened: Open) -> None:
    page = opened("bead-b2.html")
    assert page.locator("[data-choice=posterior] .main-svg").count() > 0
    page.locator("a[data-key='0/z']").click()
    assert "z was not recorded" in page.locator("[data-caption=spectrum]").inner_text()
    assert page.locator("[data-choice=posterior] .main-svg").count() == 0


def test_what_is_named_is_drawn_before_and_after(opened: Open) -> None:
    page = opened(GOOD)
    assert page.locator("[data-figure=before_after] .point").count() == 3 * 3 * 20
    assert page.locator("[data-figure=residuals] .hm").count() == 2


def test_what_no_effect_explains_is_drawn(opened: Open) -> None:
    page = opened("bead-b10.html")
    assert page.locator("[data-figure=unexplained] .main-svg").count() > 0
    assert page.locator("[data-figure=unexplained] .point").count() == 90
    assert page.locator("[data-figure=shapes] .point").count() == 32


def luminance(page: Any, element: str, which: str) -> float:
    """Mean of red, green and blue of a colour that an element has, from 0 to 1."""
    script = f"e => getComputedStyle(e)['{which}'].match(/[0-9.]+/g).slice(0, 3).map(Number)"
    return sum(page.locator(element).first.evaluate(script)) / (3 * 255)


def test_a_dark_screen_has_dark_pages_and_figures(
    browser: Any, report: Path, complaints: list[str]
) -> None:
    page = new_page(browser, complaints, width=1280, color_scheme="dark")
    page.goto((report / GOOD).as_uri())
    page.evaluate(DRAW_ALL)
    page.wait_for_function(DRAWN)
    ground, title = "[data-figure=traces] .main-svg", "[data-figure=traces] .x3title"
    for element, which, dark in (
        ("body", "backgroundColor", True),
        ("body", "color", False),
        (ground, "backgroundColor", True),
        (title, "fill", False),
    ):
        assert (luminance(page, element, which) < 0.3) == dark, (element, which)
    # on paper everything is dark on white again, and dark afterwards
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert luminance(page, ground, "backgroundColor") == 1
    assert luminance(page, "body", "backgroundColor") == 1
    assert luminance(page, title, "fill") < 0.3
    page.emulate_media(media="screen")
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert luminance(page, ground, "backgroundColor") < 0.3
    # a screen that changes while the page is open
    page.emulate_media(color_scheme="light")
    page.wait_for_function(
        f"getComputedStyle(document.querySelector('{ground}')).backgroundColor"
        " === 'rgb(255, 255, 255)'"
    )
    page.close()


def test_reasons_are_in_view_on_a_telephone(
    browser: Any, report: Path, complaints: list[str]
) -> None:
    page = new_page(browser, complaints, width=390)
    page.goto((report / "index.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    said = page.locator("article p, article .reasons li")
    assert said.count() >= 6
    for box in [one.bounding_box() for one in said.all()]:
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390
    # what is said of a reference bead has to be scrolled to, but is no column of single words
    said_there = page.locator("td.sentence").filter(has_text="jumps").bounding_box()
    assert said_there["width"] > 16 * 13
    page.close()


def test_the_keyboard_stops_at_what_can_be_used(opened: Open) -> None:
    stops = """() => [...document.querySelectorAll("a[href], button, input, select, summary")]
        .concat(...document.querySelectorAll("[tabindex]"))
        .filter(e => e.tabIndex >= 0 && e.checkVisibility()).map(e => e.className || e.tagName)"""
    page = opened(GOOD)
    page.set_viewport_size({"width": 1280, "height": 800})
    assert page.locator(".modebar-btn").count() > 20  # of charts: they are there for the mouse
    reached = page.evaluate(stops)
    assert not [name for name in reached if "modebar" in name]
    assert len(reached) < 20
    page.set_viewport_size({"width": 500, "height": 800})  # now the tables have to be scrolled
    page.wait_for_function("document.querySelectorAll('.scroll[tabindex]').length > 0")


def test_plotly_is_there_once_for_all_pages(report: Path) -> None:
    large = [path for path in report.iterdir() if path.stat().st_size > 1e6]
    assert [path.name for path in large] == ["plotly.min.js"]
    for page in report.glob("*.html"):
        assert '<script src="plotly.min.js" defer></script>' in page.read_text(encoding="utf-8")


def test_charts_are_drawn_as_they_come_into_sight(
    browser: Any, report: Path, complaints: list[str]
) -> None:
    page = new_page(browser, complaints, width=1280)
    page.goto((report / GOOD).as_uri())
    page.wait_for_function("document.querySelector('[data-figure=picture] .main-svg')")
    traces = page.locator("[data-figure=traces] .main-svg")
    assert traces.count() == 0
    page.locator("#traces").scroll_into_view_if_needed()
    traces.first.wait_for(timeout=5000)
    page.close()


@pytest.mark.parametrize("name", ["index.html", GOOD])
def test_nothing_that_is_printed_is_torn_or_lost(
    browser: Any, report: Path, complaints: list[str], name: str
) -> None:
    page = new_page(browser, complaints, width=1280)
    page.goto((report / name).as_uri())
    page.emulate_media(media="print")
    whole = page.locator("figure, article, .opening, tr")
    breaks = whole.evaluate_all("all => all.map(e => getComputedStyle(e).breakInside)")
    assert set(breaks) == {"avoid"}
    lines = page.locator("p, li").evaluate_all(
        "all => all.map(e => Math.min(getComputedStyle(e).orphans, getComputedStyle(e).widows))"
    )
    assert set(lines) == {3}
    left_out = page.locator("nav, .filter, .chooser, footer")
    assert left_out.count() > 0
    assert not any(one.is_visible() for one in left_out.all())
    assert page.pdf(prefer_css_page_size=True)[:4] == b"%PDF"
    assert page.locator("[data-figure] .main-svg").count() > 0
    page.close()


@pytest.mark.parametrize("name", ["index.html", GOOD, "bead-b2.html"])
def test_every_page_draws_and_fits_a_narrow_window(opened: Open, name: str) -> None:
    page = opened(name)
    assert page.locator("[data-figure] .main-svg .trace path").count() > 0
    page.set_viewport_size({"width": 700, "height": 800})
    page.wait_for_function("document.documentElement.scrollWidth <= 700", timeout=5000)


def test_a_thousand_beads_of_a_batch_are_sorted_and_filtered(
    browser: Any, tmp_path: Path, complaints: list[str]
) -> None:
    (tmp_path / "index.html").write_text(batch_page(thousand_beads(), [("notes.txt", "is empty")]))
    page = new_page(browser, complaints, width=1280)
    page.goto((tmp_path / "index.html").as_uri())
    shown = page.locator("tbody tr:visible")
    assert shown.count() == 1000
    page.get_by_role("button", name="largest force").click()
    assert "day 1/r7.csv" in shown.first.text_content()
    page.get_by_role("button", name="largest force").click()
    assert "day 1/r999.csv" in shown.first.text_content()
    assert shown.last.text_content().strip().endswith("no force")  # no number is no small one
    page.get_by_role("searchbox").fill("r99 reason")
    assert shown.count() == 11
    assert page.locator("#count").text_content() == "11 of 1000 rows shown"
    page.get_by_role("searchbox").fill("")
    page.get_by_label("caution").uncheck()
    assert shown.count() == 500
    page.get_by_label("failed").uncheck()
    assert shown.count() == 499
    link = shown.first.get_by_role("link").get_attribute("href")
    assert unquote(link).endswith(".csv/report/bead-b1.html")
    assert page.get_by_text("notes.txt: is empty").is_visible()


def thousand_beads() -> list[dict[str, Any]]:
    """Rows of a summary."""
    return [
        {
            "recording": f"day 1/r{k}.csv",
            "bead": "b1",
            "status": "failed" if k == 4 else "done",
            "verdict": ("good", "caution")[k % 2],
            "mismatch": "consistent",
            "force_min_pN": 0.5,
            # the least is the eighth's
            "force_max_pN": None if k == 0 else 0.1 if k == 7 else float(k),
            "persistence_length_nm": 50.0 + k / 100,
            "persistence_length_stderr_nm": 1.0,
            "contour_length_nm": 2700.0,
            "contour_length_stderr_nm": 3.0,
            "reasons": "no force" if k == 0 else f"reason {k}",
            "report": f"day 1/r{k}.csv/report/bead-b1.html",
        }
        for k in range(1000)
    ]
