"""What a report shows, as files: figures for print, tables as CSV, pages as PDF."""

import re
import shutil
import xml.etree.ElementTree as ET
import zlib

import pandas as pd
import pytest
from typer.testing import CliRunner

from mtpipe.cli.entry import app
from mtpipe.report import browser, write_report
from mtpipe.report.browser import figures_of
from mtpipe.report.export import write_figures, write_pdf, write_tables
from tests.report_folder import NASTY, write_run_folder

pytestmark = pytest.mark.slow

chromium = pytest.mark.skipif(
    not any(map(shutil.which, browser.NAMES)), reason="there is no chromium on this machine"
)
GOOD_PAGE = "bead-b-id-x-b-1-2"
COLUMN_PX, PAGE_PX = 336, 692  # 89 and 183 mm


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = write_run_folder(tmp_path_factory.mktemp("run") / "a run")
    write_report(folder)
    for page in (folder / "report").glob("*.html"):  # two pages show it as well as all
        if page.stem not in ("index", GOOD_PAGE):
            page.unlink()
    return folder


@chromium
def test_every_figure_of_a_report_is_a_file_for_print(folder):
    written = write_figures(folder)
    assert written == folder / "report" / "figures"
    assert {"forces.svg", "drift.svg"} <= {path.name for path in written.glob("*.svg")}
    found = {path.stem for path in (written / GOOD_PAGE).iterdir()}
    assert {"force_extension", "traces", "crosscheck", "spectrum-0-x", "posterior-0-x"} <= found
    for path in written.rglob("*.svg"):
        top = ET.fromstring(path.read_text(encoding="utf-8"))
        assert int(top.attrib["width"]) in (COLUMN_PX, PAGE_PX)
        sizes = set(re.findall(r"font-size: ([\d.]+)px", path.read_text(encoding="utf-8")))
        assert max(map(float, sizes)) < 11
    curve = (written / GOOD_PAGE / "force_extension.svg").read_text(encoding="utf-8")
    assert "mean extension / nm" in curve
    assert "prefers-color-scheme" not in curve


@chromium
def test_figures_as_pdf_and_pages_as_pdf_are_drawn(folder, monkeypatch):
    drawn = {"forces": figures_of(folder / "report" / "index.html", _script())["forces"]}
    monkeypatch.setattr("mtpipe.report.export.figures_of", lambda page, script: drawn)
    figure = write_figures(folder, "pdf") / "forces.pdf"
    assert _lines(figure) > 10
    width = float(re.search(rb"/MediaBox \[0 0 ([\d.]+)", figure.read_bytes())[1])
    assert width == pytest.approx(COLUMN_PX * 72 / 96, abs=2)
    pages = write_pdf(folder)
    assert {path.stem for path in pages.iterdir()} == {
        path.stem for path in (folder / "report").glob("*.html")
    }
    assert _lines(pages / f"{GOOD_PAGE}.pdf") > 2000


def _script():
    from importlib.resources import files

    return (files("mtpipe.report") / "static" / "export.js").read_text(encoding="utf-8")


def _lines(path):
    """How many lines and curves a PDF draws."""
    count = 0
    for stream in re.findall(rb"stream\r?\n(.*?)endstream", path.read_bytes(), re.DOTALL):
        try:
            count += len(re.findall(rb" [lc]\n", zlib.decompress(stream)))
        except zlib.error:
            continue
    return count


def test_every_table_is_a_csv(folder):
    written = write_tables(folder)
    names = {path.stem for path in written.iterdir()}
    assert {"forces", "beads", "crosscheck", "spectra", "force_extension"} <= names
    forces = pd.read_csv(written / "forces.csv")
    kept = pd.read_parquet(folder / "forces.parquet")
    assert list(forces.columns)[: len(kept.columns)] == list(kept.columns)
    mine = forces[(forces.bead == NASTY) & (forces.plateau == 0)]
    assert len(mine) == 3


def test_without_a_browser_one_sentence_says_so(folder, monkeypatch):
    monkeypatch.setenv("PATH", "")
    for option in ("--figures", "--pdf"):
        done = CliRunner().invoke(app, ["report", str(folder), option])
        assert done.exit_code == 1
        assert "Install chromium" in str(done.exception)
        assert (folder / "report" / "index.html").exists()
