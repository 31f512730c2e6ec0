"""`mtpipe magnet-curve`: the magnet's curve again, from a folder of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mtpipe.cli.commands import app
from mtpipe.ground.errors import writing
from mtpipe.ground.streams import say


@app.command()
def magnet_curve(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="Folder with runs below it.", exists=True, file_okay=False
        ),
    ],
) -> None:
    """Fit force against magnet position.

    All beads of all runs below a folder are used.
    """
    from mtpipe.pipeline.magnet_curve import FIGURE, runs_below, write_magnet_curve

    with writing(folder, "DIR"):
        say(write_magnet_curve(folder, runs_below(folder)))
    say(f"Figure: {folder / FIGURE}")
