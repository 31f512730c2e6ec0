"""`mtpipe report`: the report of a run again, and what it shows as files."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from mtpipe.cli.commands import app
from mtpipe.cli.terminal import progress_bar
from mtpipe.ground.errors import writing
from mtpipe.ground.streams import say

RunFolder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of a run.", exists=True, file_okay=False)
]


class FigureFormat(StrEnum):
    """How figures are written."""

    svg = "svg"
    pdf = "pdf"


@app.command()
def report(
    folder: RunFolder,
    figures: Annotated[
        bool,
        typer.Option("--figures", help="Every figure too, for print: DIR/report/figures."),
    ] = False,
    form: Annotated[
        FigureFormat, typer.Option("--format", help="Of the figures.", case_sensitive=False)
    ] = FigureFormat.svg,
    tables: Annotated[
        bool,
        typer.Option("--tables", help="Every table too, as CSV: DIR/report/tables."),
    ] = False,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Every page too, as PDF: DIR/report/pdf.")
    ] = False,
) -> None:
    """Write the report of a run again, from the run's files; also its figures, tables and pages."""
    from mtpipe.report import export, write_report

    with writing(folder, "DIR"), progress_bar() as progress:
        index = write_report(folder)
        if tables:
            say(f"Tables: {export.write_tables(folder)}")
        if figures:
            written = export.write_figures(folder, form.value, progress=progress)
            say(f"Figures: {written}")
        if pdf:
            say(f"PDF: {export.write_pdf(folder, progress=progress)}")
    say(f"Report: {index}")
