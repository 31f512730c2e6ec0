"""Markdown tables that set methods side by side: a row per method, a column per corner frequency.

Errors are those of ln stiffness (k) and ln friction (γ), over the traces that gave a result; how
many did not is a table of its own. A dash stands where there are too few to tell.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pandas as pd
from report import bias, percent, rms, table
from traces import Case

LIKELIHOOD, POSTERIOR = "mtpipe likelihood", "mtpipe posterior"
DEFAULT_START, SAMPLED = ", default start", ", MCMC"  # what tweezepy_peer/fit.py calls its variants
EXPOSURES = {1.0: "whole", 0.5: "half"}
FEWEST = 2
Cell = Callable[[pd.DataFrame], str]


def blocks(cases: Sequence[Case], rows: pd.DataFrame) -> dict[str, str]:
    """Name → Markdown of every table, from rows as `methods.measure` gives them."""
    free = [case for case in cases if case.part == "free"]
    noisy = [case for case in cases if case.part == "noisy"]
    sampled = rows.method.str.endswith(SAMPLED)
    grid = rows[~sampled & ~rows.method.str.endswith(DEFAULT_START)]
    told = {"summary": summary_table(free, grid)}
    for exposure, name in EXPOSURES.items():
        some = [case for case in free if case.exposure == exposure]
        told[f"rms {name}"] = side_by_side(some, grid, over_bound, bound="{:.2%}")
        told[f"bias {name}"] = side_by_side(some, grid, _bias)
        told[f"coverage {name}"] = side_by_side(some, grid, coverage)
        told[f"missing {name}"] = side_by_side(some, rows[~sampled], missing)
    told["noisy rms"] = side_by_side(noisy, grid, _rms_percent, bound="{:.1%}")
    told["noisy bias"] = side_by_side(noisy, grid, _bias)
    told["noisy within"] = side_by_side(noisy, grid, within_ten_percent)
    told["noisy coverage"] = side_by_side(noisy, grid, coverage)
    told["noisy missing"] = side_by_side(noisy, grid, missing)
    told["time"] = time_table(free, noisy, rows)
    return told


def side_by_side(
    cases: Sequence[Case], rows: pd.DataFrame, cell: Cell, bound: str | None = None
) -> str:
    """One row per method, one column per case; with a format, the bound of k as the first row."""
    groups = [rows[rows.case == case.name] for case in cases]
    lines = []
    if bound is not None:
        lines.append(["bound", *(bound.format(group.k_bound.iloc[0]) for group in groups)])
    lines += [
        [method, *(cell(group[group.method == method]) for group in groups)]
        for method in pd.concat(groups).method.unique()
    ]
    return table(" | ".join(["corner / Nyquist", *(f"{case.corner:g}" for case in cases)]), lines)


def summary_table(cases: Sequence[Case], rows: pd.DataFrame) -> str:
    """One row per method: how it does over the grid of traces without noise."""
    some = rows[rows.case.isin([case.name for case in cases])]
    lines = []
    for method, one in some.groupby("method", sort=False):
        line = [str(method)]
        for exposure in EXPOSURES:
            at = [case.name for case in cases if case.exposure == exposure]
            ratios = [
                rms(got.k_error / got.k_bound)
                for _, got in one[one.case.isin(at) & one.k_error.notna()].groupby("case")
                if len(got) >= FEWEST
            ]
            line.append(f"{sum(ratios) / len(ratios):.2f}" if ratios else "–")
        line += [_largest_bias(one), coverage(one), missing(one)]
        lines.append(line)
    return table(
        "method | rms k / bound, exposure a whole frame | half a frame"
        " | largest bias k where the bound is below 10 % (%) | 68 %: k, γ"
        " | without a result (%)",
        lines,
    )


def time_table(free: Sequence[Case], noisy: Sequence[Case], rows: pd.DataFrame) -> str:
    """Median CPU time of one fit of each method, and its ratio to mtpipe's."""
    parts = [rows[rows.case.isin([case.name for case in part])] for part in (free, noisy)]
    medians = [part.groupby("method").cpu_s.median() for part in parts]
    lines = []
    for method in rows.method.unique():
        line = [method]
        for median in medians:
            if method in median:
                ratio = median[method] / median[LIKELIHOOD]
                line += [f"{1e3 * median[method]:.1f}", f"{ratio:.1f}"]
            else:
                line += ["–", "–"]
        lines.append(line)
    return table(
        "method | CPU ms, no noise | times mtpipe's likelihood | CPU ms, noise of unknown size"
        " | times mtpipe's likelihood",
        lines,
    )


def over_bound(one: pd.DataFrame) -> str:
    """Root-mean-square error of k over the Cramér–Rao bound."""
    errors = (one.k_error / one.k_bound).dropna()
    return f"{rms(errors):.2f}" if len(errors) >= FEWEST else "–"


def coverage(one: pd.DataFrame) -> str:
    """Percent of the stated 68 % intervals of k and of γ that hold the truth."""
    return ", ".join(percent(one[f"{name}_holds"].dropna()) for name in ("k", "friction"))


def missing(one: pd.DataFrame) -> str:
    """Percent of the traces without a stiffness."""
    return percent(one.k_error.isna())


def within_ten_percent(one: pd.DataFrame) -> str:
    """Percent of all traces whose stiffness is within 10 %; no result is not within."""
    return percent(one.k_error.abs() < 0.1)


def _rms_percent(one: pd.DataFrame) -> str:
    errors = one.k_error.dropna()
    return f"{rms(errors):.1%}" if len(errors) >= FEWEST else "–"


def _bias(one: pd.DataFrame) -> str:
    errors = one.k_error.dropna()
    return bias(errors) if len(errors) >= FEWEST else "–"


def _largest_bias(one: pd.DataFrame) -> str:
    groups = [
        got.k_error.dropna()
        for _, got in one[one.k_bound < 0.1].groupby("case")
        if got.k_error.notna().sum() >= FEWEST
    ]
    return bias(max(groups, key=lambda errors: abs(errors.mean()))) if groups else "–"
