"""The report's pages, without a browser: text of the tables, escaping, charts, refusals."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pandas as pd
import pytest

from mtpipe.ground.errors import MtpipeError
from mtpipe.report import write_report
from mtpipe.report.folder import COLUMNS
from mtpipe.report.pages import page_names
from tests.report_folder import NASTY, NO_Z, REFUSED, write_run_folder
from tests.report_page import Page

GOOD = "bead-b-id-x-b-1-2.html"
DESCRIPTION = Path(__file__).parents[1] / "docs" / "run-folder.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = write_run_folder(tmp_path_factory.mktemp("run") / "run")
    write_report(made)
    return made


@pytest.fixture(scope="module")
def pages(folder: Path) -> dict[str, Page]:
    return {path.name: Page(path) for path in sorted((folder / "report").glob("*.html"))}


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
    for own in ("report.css", "charts.js", "lists.js"):
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


@pytest.mark.slow
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
    assert "The recording" not in page.lines


@pytest.mark.slow
def test_a_limit_is_shown_as_one(tmp_path: Path) -> None:
    folder = write_run_folder(tmp_path / "run", good=1, plateaus=2)
    page = Page(write_report(folder).with_name("bead-more0.html"))
    start = next(i for i, row in enumerate(page.rows) if row[:1] == ["Model"])
    moduli = [row[3] for row in page.rows[start + 1 : start + 4]]
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


def test_the_page_says_where_the_forces_come_from(pages: dict[str, Page]) -> None:
    good = " ".join(pages[GOOD].text.split())
    assert (
        "One joint fit describes 7 spectra of x and y: x and y of a plateau have the same" in good
    )
    assert "The friction is the one expected from radius" in good
    assert "Plateau 2 along y contradicts the others and was fitted separately." in good
    assert re.search(r"1391 ± 17 nm\s*setup: 1400 ± 30 nm", good)
    no_z = " ".join(pages["bead-b2.html"].text.split())
    assert "Each spectrum was fitted separately (friction expected from the setup)." in no_z
    assert "A joint fit needs the extension, which is not known." in no_z
    assert "fitted separately" not in pages["bead-b10.html"].text


def test_noise_by_spectra_stands_beside_noise_by_images(pages: dict[str, Page]) -> None:
    good = " ".join(pages[GOOD].text.split())
    assert "Tracking noise: x 1 nm by its images, 1.21 ± 0.07 nm by its spectra; y 1.1 nm" in good
    assert "; z 3.2 nm by its images, not determined by its spectra." in good
    assert "by its images" not in pages["bead-b2.html"].text


def test_beads_of_the_fixture_cover_the_verdicts(folder: Path) -> None:
    beads = pd.read_parquet(folder / "beads.parquet").set_index("bead")["verdict"]
    assert dict(beads) == {NASTY: "good", NO_Z: "caution", REFUSED: "refused"}
