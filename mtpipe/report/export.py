"""What a report shows as files of its own: figures for print, tables as CSV, pages as PDF.

Figures and pages are drawn by the report's own scripts in a browser without a window
(`mtpipe.report.browser`), so that they are what the pages show. Each kind fills a folder of
`report/`, whole or not at all. A report that is written again takes them with it (`exported`,
`export`), so that files never show another state of the run than the pages.
"""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass
from importlib.resources import files as resources
from pathlib import Path
from typing import Literal

from mtpipe.ground.files import folder_written_whole
from mtpipe.ground.progress import by_name
from mtpipe.ground.spreadsheets import as_csv
from mtpipe.ground.types import NamedProgress
from mtpipe.report.browser import figures_of, find_browser, print_pdf
from mtpipe.report.folder import COLUMNS
from mtpipe.report.marked import read_marked_run

Format = Literal["svg", "pdf"]
# A page that is as large as the figure on it, in CSS pixels as the figure says them.
SHEET = """<!doctype html><meta charset="utf-8">
<style>
@page {{ size: {width}px {height}px; margin: 0 }}
body {{ margin: 0 }}
svg {{ display: block }}
</style>
{svg}"""


@dataclass(frozen=True)
class Exports:
    """Which files are beside a report; `figures` is their format, None where there are none."""

    figures: Format | None = None
    tables: bool = False
    pdf: bool = False

    def __or__(self, other: Exports) -> Exports:
        """What either has; figures in the format of the first."""
        return Exports(
            self.figures or other.figures, self.tables or other.tables, self.pdf or other.pdf
        )


def exported(folder: Path) -> Exports:
    """What was exported of a run's report, as the files beside it show."""
    report = folder / "report"
    form: Format = "pdf" if any((report / "figures").rglob("*.pdf")) else "svg"
    return Exports(
        form if (report / "figures").is_dir() else None,
        (report / "tables").is_dir(),
        (report / "pdf").is_dir(),
    )


def export(
    folder: Path, exports: Exports, *, progress: NamedProgress | None = None
) -> list[tuple[str, Path]]:
    """Write files beside the report of a run: what each is in a word, and where.

    Raises
    ------
    MtpipeError : as the functions that write them.
    """
    written = []
    if exports.tables:
        written.append(("Tables", write_tables(folder)))
    if exports.figures is not None:
        written.append(("Figures", write_figures(folder, exports.figures, progress=progress)))
    if exports.pdf:
        written.append(("PDF", write_pdf(folder, progress=progress)))
    return written


def write_figures(
    folder: Path, form: Format = "svg", *, progress: NamedProgress | None = None
) -> Path:
    """Write every figure of a run's report into `folder/report/figures/`, as a journal prints it.

    Those of all beads stand there, those of one bead in a folder called as its page is.
    Figures are 89 or 183 mm wide, with type of 8 points.

    Parameters
    ----------
    folder : of a run, with its report.

    Returns
    -------
    Path of `figures/`.

    Raises
    ------
    MtpipeError : there is no browser, or it failed.
    """
    find_browser()
    say = by_name(progress)
    script = (resources("mtpipe.report") / "static" / "export.js").read_text(encoding="utf-8")
    pages = _pages(folder)
    with folder_written_whole(folder / "report" / "figures") as target:
        for done, page in enumerate(pages):
            say("drawing figures", done, len(pages))
            place = target if page.stem == "index" else target / page.stem
            place.mkdir(exist_ok=True)
            for name, svg in figures_of(page, script).items():
                if form == "svg":
                    (place / f"{name}.svg").write_text(svg, encoding="utf-8")
                else:
                    _print_figure(svg, place / f"{name}.pdf")
    return folder / "report" / "figures"


def write_tables(folder: Path) -> Path:
    """Write every table of a run, as its marks leave it, into `folder/report/tables/` as CSV.

    Returns
    -------
    Path of `tables/`.

    Raises
    ------
    RunFolderError : a file of the run folder is missing or damaged.
    """
    run = read_marked_run(folder)
    with folder_written_whole(folder / "report" / "tables") as target:
        for name in COLUMNS:
            stem = Path(name).stem
            (target / f"{stem}.csv").write_text(as_csv(getattr(run, stem)), encoding="utf-8")
        if len(run.others):
            (target / "other_methods.csv").write_text(as_csv(run.others), encoding="utf-8")
    return folder / "report" / "tables"


def write_pdf(folder: Path, *, progress: NamedProgress | None = None) -> Path:
    """Print every page of a run's report into `folder/report/pdf/`.

    Returns
    -------
    Path of `pdf/`.

    Raises
    ------
    MtpipeError : there is no browser, or it failed.
    """
    find_browser()
    say = by_name(progress)
    pages = _pages(folder)
    with folder_written_whole(folder / "report" / "pdf") as target:
        for done, page in enumerate(pages):
            say("printing pages", done, len(pages))
            print_pdf(page, target / f"{page.stem}.pdf")
    return folder / "report" / "pdf"


def _pages(folder: Path) -> list[Path]:
    return sorted((folder / "report").resolve().glob("*.html"), key=lambda one: one.stem != "index")


def _print_figure(svg: str, out: Path) -> None:
    width, height = (re.search(rf'{side}="([\d.]+)"', svg) for side in ("width", "height"))
    assert width is not None
    assert height is not None
    with tempfile.TemporaryDirectory() as scratch:
        sheet = Path(scratch) / "figure.html"
        text = SHEET.format(width=width[1], height=height[1], svg=svg)
        sheet.write_text(text, encoding="utf-8")
        print_pdf(sheet, out)
