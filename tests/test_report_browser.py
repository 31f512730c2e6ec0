"""The report in a real browser: opens from disk, draws, sorts, chooses, prints."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from mtpipe.report import write_report
from tests.report_folder import write_run_folder

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium on this machine")
QUIET = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
)
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
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("requestfailed", lambda request: complaints.append(f"failed: {request.url}"))
        page.on("request", lambda request: complaints.extend(_outside(request.url)))
        page.goto((report / name).as_uri())
        page.wait_for_function(DRAWN)
        return page

    return opened


@pytest.fixture(autouse=True)
def _nothing_goes_wrong(complaints: list[str]) -> Iterator[None]:
    yield
    assert complaints == []


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
    assert all(width == 680 for width, _ in printed)
    assert [h for _, h in printed] == [round(0.8 * height) for _, height in before]
    assert page.locator("details:not([open])").count() == 0
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(sizes) == before
    assert page.locator("details[open]").count() == 0


def test_the_table_of_forces_fits_the_window(opened: Open) -> None:
    page = opened(GOOD)
    page.set_viewport_size({"width": 1280, "height": 800})
    table = page.locator(".scroll.wide")
    assert table.evaluate("place => place.scrollWidth - place.clientWidth") == 0
    # the columns stay in line where x and y have one cell between them
    lefts = (
        "cells => [...new Set(cells.map(cell => Math.round(cell.getBoundingClientRect().left)))]"
    )
    assert len(page.locator("table.forces tbody th[scope=row]").evaluate_all(lefts)) == 1
    assert len(page.locator("table.forces tbody td.status").evaluate_all(lefts)) == 1


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


@pytest.mark.parametrize("name", ["index.html", GOOD, "bead-b2.html"])
def test_every_page_draws_and_fits_a_narrow_window(opened: Open, name: str) -> None:
    page = opened(name)
    assert page.locator("[data-figure] .main-svg .trace path").count() > 0
    page.set_viewport_size({"width": 700, "height": 800})
    page.wait_for_function("document.documentElement.scrollWidth <= 700", timeout=5000)
