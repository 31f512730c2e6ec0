"""The command line: what `mtpipe --help` lists.

Exit codes: 0 done, 1 the data could not be processed, 2 the call was wrong. Errors are one or a few
plain lines on standard error; a traceback appears only with MTPIPE_DEBUG set in the environment.
"""

from __future__ import annotations

import os
import sys
import traceback
from pathlib import Path
from typing import Annotated

import typer

import mtpipe
from mtpipe.errors import MtpipeError
from mtpipe.terminal import progress_bar, summary

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Force calibration for magnetic tweezers: from tracked beads to forces you can defend.",
)

Recording = Annotated[
    Path,
    typer.Argument(
        metavar="RECORDING",
        help="Recording (CSV, Parquet, or a laboratory's own file), a folder with a series of "
        "files, or a setup.toml whose [source] names its files.",
        exists=True,
    ),
]
SetupFile = Annotated[
    Path | None,
    typer.Option("--setup", help="Setup; default: setup.toml beside the recording.", exists=True),
]
Seed = Annotated[int, typer.Option(help="Seed of the posteriors.", min=0)]
Workers = Annotated[int | None, typer.Option(help="Processes; default: one per core.", min=1)]


def _known_methods(names: list[str]) -> list[str]:
    from mtpipe.methods import METHODS

    for name in names:
        if name not in METHODS:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(METHODS)}")
    return names


Methods = Annotated[
    list[str] | None,
    typer.Option(
        "--method",
        help="Another method of the field by which each trace is calibrated too, for comparison: "
        "equipartition, arctangent, allan, hadamard, … May be given several times.",
        callback=lambda names: _known_methods(names or []),
    ),
]


@app.callback(invoke_without_command=True)
def about(
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    """Force calibration for magnetic tweezers: from tracked beads to forces you can defend."""
    if version:
        typer.echo(f"mtpipe {mtpipe.__version__}")
        raise typer.Exit


@app.command()
def run(
    recording: Recording,
    out: Annotated[Path, typer.Option("--out", help="Folder to write.", file_okay=False)],
    setup: SetupFile = None,
    seed: Seed = 0,
    workers: Workers = None,
    method: Methods = None,
) -> None:
    """Calibrate a recording: forces, force-extension curves and a report."""
    from mtpipe import pipeline

    with progress_bar() as progress:
        result = pipeline.run(
            recording,
            out,
            setup=setup,
            seed=seed,
            workers=workers or os.cpu_count() or 1,
            methods=method or (),
            progress=progress,
        )
    summary(result, out)


@app.command()
def report(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of a run.", exists=True, file_okay=False)
    ],
) -> None:
    """Write the report of a run again, from the run's files."""
    from mtpipe.report import write_report

    typer.echo(f"Report: {write_report(folder)}")


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder to write.", file_okay=False)] = Path(
        "mtpipe-demo"
    ),
    workers: Workers = None,
) -> None:
    """Run on the bundled recordings and compare with the forces that made them."""
    from mtpipe.demo import run_demo

    with progress_bar() as progress:
        text = run_demo(out, workers=workers or os.cpu_count() or 1, progress=progress)
    typer.echo(text)


def main() -> None:
    """Run the command line; every fault ends in a sentence and an exit code."""
    try:
        app()
    except MtpipeError as error:
        typer.echo(f"mtpipe: {error}", err=True)
    except Exception as error:
        if os.environ.get("MTPIPE_DEBUG"):
            traceback.print_exc()
        typer.echo(
            f"mtpipe: a defect of mtpipe itself: {type(error).__name__}: {error}\n"
            "Set MTPIPE_DEBUG=1 to see where, and please report it.",
            err=True,
        )
    sys.exit(1)
