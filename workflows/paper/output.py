"""What every part of the workflow shares: its arguments, the form of its tables, its figures.

A part writes `<name>.md` (its tables, ready for the page), `paper-<name>.png`, and CSV files with
all digits into the folder of results.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

# Colour-blind safe (Okabe & Ito), one colour per method throughout.
COLOURS = {
    "truth": "#000000",
    "arctangent-uncorrected": "#D55E00",
    "arctangent-blur-only": "#E69F00",
    "arctangent-one-alias": "#56B4E9",
    "arctangent": "#0072B2",
    "exact fit": "#009E73",
}
LABELS = {
    "arctangent-uncorrected": "no correction",
    "arctangent-blur-only": "blur only",
    "arctangent-one-alias": "blur, n = −1",
    "arctangent": "blur, n = ±1",
    "exact fit": "exact fit",
}
DOTS_PER_INCH = 90


@dataclass(frozen=True)
class Part:
    """One part's answer.

    Attributes
    ----------
    text : Markdown, without a heading.
    figure : what is drawn beside it.
    tables : name → all digits.
    """

    text: str
    figure: Figure
    tables: dict[str, pd.DataFrame]


def write_part(name: str, of: Callable[[int, int], Part], *, repeats: int, unit: str) -> None:
    """Run a part from the command line: `python <part>.py RESULTS [--seed S] [--repeats N]`.

    Parameters
    ----------
    of : (seed, repeats) → Part.
    repeats, unit : how much is simulated by default, and of what.
    """
    parser = argparse.ArgumentParser(description=f"{name} of te Velthuis et al. 2010")
    parser.add_argument("results", type=Path, help="folder for the results")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=repeats, help=unit)
    arguments = parser.parse_args()
    arguments.results.mkdir(parents=True, exist_ok=True)
    part = of(arguments.seed, arguments.repeats)
    for table, frame in part.tables.items():
        frame.to_csv(arguments.results / f"{name}-{table}.csv", index=False)
    part.figure.savefig(arguments.results / f"paper-{name}.png", dpi=DOTS_PER_INCH, metadata={})
    plt.close(part.figure)
    (arguments.results / f"{name}.md").write_text(part.text.strip() + "\n", encoding="utf-8")


def markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def percent(value: float, stderr: float | None = None) -> str:
    """A relative deviation, with its standard error if it has one."""
    if not np.isfinite(value):
        return "no fit"
    shown = f"{100 * value:+.1f}"
    return f"{shown} %" if stderr is None else f"{shown} ± {100 * stderr:.1f} %"


def panels(columns: int, *, rows: int = 1, width: float = 9.0, height: float = 3.4) -> tuple:
    """A figure and its panels, flattened."""
    figure, axes = plt.subplots(
        rows, columns, figsize=(width, height), layout="constrained", squeeze=False
    )
    for axis in axes.flat:
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=8)
    return figure, list(axes.flat)
