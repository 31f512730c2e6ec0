"""Values given on the command line, checked before any work: a wrong one ends with exit code 2.

Each check takes what was written and gives it back in the form that is needed, or says in a
sentence what would be right.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

RECORDING_ENDINGS = (".csv", ".csv.gz", ".parquet")
FIGURE_ENDINGS = (".html", ".png")
SMALLEST_REGION = 16
# Far more than any magnet pulls and any tether holds.
STRONGEST_PN = 1000.0


def existing(path: Path) -> Path:
    """A file or folder that is there, or a pattern that some file's name has."""
    from mtpipe.tracking.stack import is_pattern, named_like

    if path.exists():
        return path
    if not is_pattern(path):
        raise typer.BadParameter(f"path {str(path)!r} does not exist.")
    if not named_like(path):
        raise typer.BadParameter(f"no file has a name of the pattern {str(path)!r}.")
    return path


def with_ending(path: Path, endings: tuple[str, ...], option: str) -> None:
    """A name that says by its ending what is written."""
    if not path.name.endswith(endings):
        shown = " or ".join([", ".join(endings[:-1]), endings[-1]] if endings[1:] else endings)
        raise typer.BadParameter(f"a name that ends in {shown} is needed", param_hint=option)


def above_zero(value: float | None, what: str, option: str) -> None:
    """A number above 0, where one was given."""
    if value is not None and not (math.isfinite(value) and value > 0):
        raise typer.BadParameter(f"{what} above 0 is needed, got {value:g}", param_hint=option)


def known_methods(names: list[str]) -> list[str]:
    """Names of other methods of calibration."""
    from mtpipe.methods import METHODS

    for name in names:
        if name not in METHODS:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(METHODS)}")
    return names


def known_engine(name: str) -> str:
    """Name of an engine of the simulation."""
    from mtpipe.simulation.simulate import ENGINES

    if name not in ENGINES:
        raise typer.BadParameter(f"{name!r} is none of {', '.join(ENGINES)}")
    return name


def numbers(text: str, option: str) -> list[float]:
    """Numbers between commas."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = [math.nan]
    if not all(math.isfinite(value) for value in values):
        raise typer.BadParameter(
            f"{text!r}: numbers are needed, with commas between", param_hint=option
        )
    return values


def along_axes(text: str, option: str) -> tuple[float, float, float]:
    """One number of at least 0 for all axes, or one each."""
    values = numbers(text, option)
    if len(values) == 1:
        values *= 3
    if len(values) != 3 or min(values) < 0:
        raise typer.BadParameter("one number of at least 0 is needed, or three", param_hint=option)
    return values[0], values[1], values[2]


def region_of(text: str, option: str) -> tuple[float, float, int]:
    """Centre x, y and side of a square, in pixels."""
    values = numbers(text, option)
    if len(values) != 3 or values[2] != round(values[2]) or values[2] < SMALLEST_REGION:
        raise typer.BadParameter(
            f"x and y of the centre and a side of at least {SMALLEST_REGION} whole pixels are "
            "needed",
            param_hint=option,
        )
    return values[0], values[1], round(values[2])


Recording = Annotated[
    Path,
    typer.Argument(
        metavar="RECORDING",
        help="Recording (CSV, Parquet, or a laboratory's own file), a folder with a series of "
        "files, a setup.toml whose [source] names its files, or an image stack (as for `mtpipe "
        "track`), which is tracked first.",
        callback=existing,
    ),
]
Stack = Annotated[
    Path,
    typer.Argument(
        metavar="STACK",
        help="Images: a TIFF file of many pages, a folder with a series of files, or a pattern of "
        'their names (in quotes: "film_*.tif").',
        callback=existing,
    ),
]
SetupFile = Annotated[
    Path | None,
    typer.Option(
        "--setup",
        help="Setup; default: setup.toml beside the recording or stack.",
        exists=True,
        dir_okay=False,
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of posteriors and simulations.", min=0)]
Workers = Annotated[int | None, typer.Option(help="Processes; default: one per core.", min=1)]


Methods = Annotated[
    list[str] | None,
    typer.Option(
        "--method",
        help="Another published method by which each trace is calibrated too, for comparison: "
        "equipartition, arctangent, allan, hadamard, … May be given several times.",
        callback=lambda names: known_methods(names or []),
    ),
]
