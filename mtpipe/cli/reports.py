"""`mtpipe report`, `mtpipe mark`: a run's report again, as files, and without what is left out."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mtpipe.cli.commands import app
from mtpipe.cli.terminal import progress_bar
from mtpipe.ground.errors import writing
from mtpipe.ground.streams import say

if TYPE_CHECKING:
    from mtpipe.report.export import Exports

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
        typer.Option("--figures", help="Write every figure for print, into DIR/report/figures."),
    ] = False,
    form: Annotated[
        FigureFormat, typer.Option("--format", help="Format of the figures.", case_sensitive=False)
    ] = FigureFormat.svg,
    tables: Annotated[
        bool,
        typer.Option("--tables", help="Write every table as CSV, into DIR/report/tables."),
    ] = False,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Write every page as PDF, into DIR/report/pdf.")
    ] = False,
) -> None:
    """Write the report of a run again.

    It is made from the run's files; figures, tables and PDF pages if asked for.
    """
    from mtpipe.report.export import Exports

    _write_again(folder, Exports(form.value if figures else None, tables, pdf))


@app.command()
def mark(
    folder: RunFolder,
    bead: Annotated[str, typer.Argument(metavar="BEAD", help="Name of the bead.")],
    plateau: Annotated[
        int | None, typer.Option(help="Leave out one plateau; its number is in forces.csv.", min=0)
    ] = None,
    begin: Annotated[
        float | None,
        typer.Option("--from", metavar="S", help="Leave out a stretch of time: its start in s."),
    ] = None,
    end: Annotated[
        float | None, typer.Option("--to", metavar="S", help="End of this stretch in s.")
    ] = None,
    reason: Annotated[
        str, typer.Option(help="Why: a sentence for whoever reads the results.")
    ] = "",
    remove: Annotated[bool, typer.Option("--remove", help="Take this mark back.")] = False,
) -> None:
    """Leave out a bead, or a part of it, by hand.

    Curves, tables and report then do without the bead, the plateau or the stretch of time.
    """
    from mtpipe.report.export import Exports
    from mtpipe.report.folder import read_run_folder
    from mtpipe.report.marked import check_place
    from mtpipe.report.marks import MARKS, mark_of, read_marks, write_marks

    if not reason and not remove:
        raise typer.BadParameter("a reason is needed, for whoever reads it", param_hint="--reason")
    if (begin is None) != (end is None):
        raise typer.BadParameter("a stretch needs both --from and --to", param_hint="--from")
    new = mark_of(bead=bead, plateau=plateau, from_s=begin, to_s=end, reason=reason or "taken back")
    known = read_marks(folder)
    others = [one for one in known if not one.same_place(new)]
    if remove and len(others) == len(known):
        raise typer.BadParameter(f"there is no mark of {new.place}", param_hint="--remove")
    if not remove:
        check_place(read_run_folder(folder), new)
        others.append(new)
    with writing(folder, "DIR"):
        write_marks(folder, others)
    done = "No longer left out" if remove else "Left out"
    say(f"{done}: {new.place} ({folder / MARKS})")
    if new.stretch_s is not None:
        meanwhile = "with the mark" if remove else "without all of the plateaus it lies in"
        say(f"Give mtpipe run again with this --out; until then the forces are those {meanwhile}.")
    _write_again(folder, Exports())


def _write_again(folder: Path, wanted: Exports) -> None:
    """Write the report, what is wanted beside it, and what was beside it before."""
    from mtpipe.report import write_report
    from mtpipe.report.export import export, exported

    with writing(folder, "DIR"), progress_bar() as progress:
        wanted = wanted | exported(folder)
        index = write_report(folder)
        for what, where in export(folder, wanted, progress=progress):
            say(f"{what}: {where}")
    say(f"Report: {index}")
