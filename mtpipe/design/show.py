"""A design in words: a table for a terminal, and all ranges as a pandas table for a file."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table

from mtpipe.design.changes import Reach
from mtpipe.design.guide import Design
from mtpipe.design.limits import ForceRange
from mtpipe.design.methods import ACROSS, BOTH, METHODS
from mtpipe.design.plan import Plan

# Piped output is not folded to the width of a terminal that is not there.
PIPED_WIDTH = 200
SHORT = {
    "series": "series",
    "friction known": "friction\nknown",
    "friction free": "friction\nfree",
    "equipartition": "equi-\npartition",
    "arctangent": "arctan\nn = ±1",
    "arctangent-uncorrected": "arctan\nuncorrected",
}


def print_design(design: Design) -> None:
    """Print the ranges, what changes would buy, and what reaches the force that was asked for."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=PIPED_WIDTH)
    for line in (
        f"Forces measured within {design.error:.3g} (root-mean-square of bias and scatter):",
        describe(design.plan),
        *(notice.message for notice in design.notices),
    ):
        console.print(line, markup=False, soft_wrap=True)
    console.print()
    console.print(_ranges(design))
    console.print("\nWith one change, in pN along the field:")
    console.print(_variants(design))
    if design.reach_pN is not None:
        console.print(f"\nTo measure {design.reach_pN:g} pN within {design.error:.3g}:")
        for reach in design.reaches:
            console.print(f"  {reach_words(reach)}", markup=False, soft_wrap=True)


def describe(plan: Plan) -> str:
    """A plan in one line."""
    e = plan.experiment
    x_nm, y_nm = e.tracker.noise_nm[:2]
    noise = f"{x_nm:g}" if x_nm == y_nm else f"{x_nm:g} and {y_nm:g}"
    return ", ".join(
        (
            f"{plan.frames} frames at {1 / e.camera.frame_s:.4g} Hz ({plan.duration_s:.3g} s)",
            f"exposure {1e3 * e.camera.exposure_s:.3g} ms",
            f"bead of {e.bead.radius_nm:.4g} nm radius",
            f"tether of {e.chain.contour_length_nm:.4g} nm",
            f"{e.fluid.viscosity_mPa_s:.3g} mPa s",
            f"tracking noise {noise} nm",
        )
    )


def axis_words(plan: Plan, axis: str) -> str:
    """The axis of the camera, and how it lies to the field."""
    if axis == BOTH:
        return "x and y"
    number = 1 - plan.experiment.along if axis == ACROSS else plan.experiment.along
    return f"{'xy'[number]}, {axis} the field"


def reach_words(reach: Reach) -> str:
    """What lets a method measure the force, the cheapest first."""
    words = METHODS[reach.method].words
    now = f"error {reach.error:.1%}" if math.isfinite(reach.error) else "no result"
    if reach.within:
        return f"{words}: within already ({now})."
    if not reach.changes:
        return f"{words}: no single change reaches it ({now} as it is)."
    cheapest, *others = (change.words for change in reach.changes)
    more = f"; or {', '.join(others)}" if others else ""
    return f"{words}: {now} as it is. Cheapest: {cheapest}{more}."


def design_frame(design: Design) -> pd.DataFrame:
    """All ranges, one row each; the columns change and factor are empty for the plan as it is."""
    rows = [("", math.nan, one) for one in design.ranges]
    rows += [(v.change.kind, v.change.factor, one) for v in design.variants for one in v.ranges]
    return pd.DataFrame(
        [
            {
                "change": change,
                "factor": factor,
                "method": one.method,
                "axis": one.axis,
                "error": design.error,
                "lower_pN": math.nan if one.lower is None else one.lower.force_pN,
                "lower_limited_by": one.best_reason if one.lower is None else one.lower.reason,
                "upper_pN": math.nan if one.upper is None else one.upper.force_pN,
                "upper_limited_by": one.best_reason if one.upper is None else one.upper.reason,
                "best_force_pN": one.best_force_pN,
                "best_error": one.best_error,
            }
            for change, factor, one in rows
        ]
    )


def write_csv(design: Design, path: Path) -> None:
    """Write `design_frame` to a file."""
    # pandas says in words of its own that a folder is missing
    path.write_text(design_frame(design).to_csv(index=False), encoding="utf-8", newline="")


def _ranges(design: Design) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in ("method", "axis"):
        table.add_column(heading)
    table.add_column("from pN", justify="right")
    table.add_column("limited by", overflow="fold")
    table.add_column("to pN", justify="right")
    table.add_column("limited by", overflow="fold")
    table.add_column("best", justify="right")
    for one in design.ranges:
        low, high = one.lower, one.upper
        words, axis = METHODS[one.method].words, axis_words(design.plan, one.axis)
        best = f"{one.best_error:.1%}" if math.isfinite(one.best_error) else "-"
        if low is None or high is None:
            table.add_row(words, axis, "none", one.best_reason, "none", "", best)
        else:
            table.add_row(
                words, axis, f"{low.force_pN:.2g}", low.reason, f"{high.force_pN:.3g}",
                high.reason, best,
            )  # fmt: skip
    return table


def _variants(design: Design) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("change")
    for name in METHODS:
        table.add_column(SHORT[name], justify="right")
    now = [one for one in design.ranges if one.axis == METHODS[one.method].axes[0]]
    table.add_row("as it is", *map(_span, now))
    for variant in design.variants:
        table.add_row(variant.change.words, *map(_span, variant.ranges))
    return table


def _span(one: ForceRange) -> str:
    if one.lower is None or one.upper is None:
        return "none"
    return f"{one.lower.force_pN:.2g} – {one.upper.force_pN:.3g}"
