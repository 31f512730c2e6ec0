"""`mtpipe watch`: forces of recordings as they arrive."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from mtpipe.cli import arguments as given
from mtpipe.cli.batch import shown_in_lines
from mtpipe.cli.commands import app
from mtpipe.ground.errors import writing
from mtpipe.ground.streams import say


@app.command()
def watch(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER",
            help="Where recordings arrive, with a setup.toml beside them or in a folder above.",
            exists=True,
            file_okay=False,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder to write.", file_okay=False)],
    seed: given.Seed = 0,
    workers: given.Workers = None,
    settled: Annotated[
        float,
        typer.Option(
            metavar="SECONDS", help="A recording that has not changed for so long is complete."
        ),
    ] = 10.0,
    idle: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="End once all is calibrated and nothing has changed for so long; default: never.",
            min=0,
        ),
    ] = None,
) -> None:
    """Calibrate recordings while they are measured.

    Forces of each plateau are there soon after it ends. Ctrl-C ends the command.
    """
    from mtpipe.pipeline.summary import PAGE
    from mtpipe.pipeline.watch import watch as follow

    given.above_zero(settled, "a time in s", "--settled")
    with shown_in_lines() as lines, writing(out):
        done = follow(
            folder,
            out,
            seed=seed,
            workers=workers or os.cpu_count() or 1,
            settled_s=settled,
            idle_s=idle,
            tell=lines,
        )
    say(f"Summary: {done.out / PAGE}")
    raise typer.Exit(int(bool(done.failed)))
