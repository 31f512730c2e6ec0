"""Markdown tables from the rows that the studies collect, and their place in a page.

Biases are means of ln(measured/true), in percent with the standard error from the number of
repeats. A page holds each table between `<!-- study: name -->` and `<!-- end -->`; what stands
around is written by hand.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from recordings import SHARED, Outcome
from scipy import stats
from traces import RELAXATION_OVER_TRACE, Case

sys.path.append(str(Path(__file__).parents[1] / "common"))
from pages import table

CORNER_BANDS = (0.0, 0.1, 0.5, 1.0, 2.0, math.inf)
RELAXATION_BANDS = (0.0, 20.0, 50.0, 200.0, math.inf)


def free_table(cases: Sequence[Case], rows: pd.DataFrame) -> str:
    """Stiffness and friction free, no noise."""
    lines, averages = [], []
    for case in _of("free", cases):
        one = _rows(case, rows)
        told = one[one.identified]
        averages.append(
            {name: rms(told[f"{name}_error"] / told[f"{name}_bound"]) for name in ("k", "friction")}
        )
        lines.append([
            f"{case.exposure:g}", f"{case.corner:g}", f"{one.k_bound.median():.2%}",
            bias(told.k_error), _over_bound(told, "k"), _holding(one, "k"),
            bias(told.friction_error), _over_bound(told, "friction"), _holding(one, "friction"),
            f"{stats.kstest(one.p_value, 'uniform').pvalue:.2f}",
            percent(~one.identified),
            f"{1e3 * one.fit_s.median():.1f} / {1e3 * one.posterior_s.median():.0f}",
        ])  # fmt: skip
    means = [
        f"{name}: {np.mean([over[name] for over in averages]):.3f}" for name in ("k", "friction")
    ]
    return (
        table(
            "exposure (frames) | corner / Nyquist | bound k | bias k (%) | rms k / bound"
            " | 68 % k: fit, posterior | bias γ (%) | rms γ / bound | 68 % γ: fit, posterior | KS p"
            " | k not identified (%) | ms: fit / posterior",
            lines,
        )
        + f"\n\nRoot-mean-square error over bound, averaged over the grid: {', '.join(means)}."
    )


def noisy_table(cases: Sequence[Case], rows: pd.DataFrame) -> str:
    """Noise unknown, friction known within a few percent."""
    lines = []
    for case in _of("noisy", cases):
        one = _rows(case, rows)
        told = one[one.posterior_identified]
        lines.append([
            f"{case.corner:g}", bias(told.k_posterior_error),
            f"{rms(told.k_posterior_error):.1%}", f"{rms(one[one.identified].k_error):.1%}",
            f"{one.k_bound.median():.1%}",
            percent(told.k_posterior_error.abs() < 0.1),
            _holding(one, "k"), percent(~one.posterior_identified), percent(~one.converged),
        ])  # fmt: skip
    return table(
        "corner / Nyquist | bias k (%) | rms error k: posterior | fit | bound | within 10 % (%)"
        " | 68 % k: fit, posterior | not identified (%) | not converged (%)",
        lines,
    )


def gaps_table(cases: Sequence[Case], rows: pd.DataFrame) -> str:
    """Lost frames against none."""
    lines = []
    for case in _of("gaps", cases):
        one = _rows(case, rows)
        lines.append([
            f"{case.corner:g}", case.lost,
            bias(one.k_error), f"{rms(one.k_error):.2%}", f"{one.k_bound.median():.2%}",
            _holding(one, "k"), bias(one.friction_error), f"{rms(one.friction_error):.2%}",
            _holding(one, "friction"),
            f"{stats.kstest(one.p_value, 'uniform').pvalue:.2f}",
            f"{1e3 * one.fit_s.median():.1f} / {1e3 * one.posterior_s.median():.0f}",
        ])  # fmt: skip
    return table(
        "corner / Nyquist | frames lost | bias k (%) | rms k | stated"
        " | 68 % k: fit, posterior | bias γ (%) | rms γ | 68 % γ: fit, posterior"
        " | KS p | ms: fit / posterior",
        lines,
    )


def short_table(cases: Sequence[Case], rows: pd.DataFrame) -> str:
    """Traces that last only a few relaxation times."""
    lines = []
    for share, case in zip(RELAXATION_OVER_TRACE, _of("short", cases), strict=True):
        one = _rows(case, rows)
        statistical = float(one.k_error.std())
        lines.append([
            f"{share:g}", bias(one.k_error), f"{statistical:.1%}",
            f"{one.k_error.mean() / statistical:+.2f}",
            f"{one.k_posterior_error.mean() / statistical:+.2f}",
            _holding(one, "k"), bias(one.friction_error), _holding(one, "friction"),
            percent(~one.posterior_identified),
        ])  # fmt: skip
    return table(
        "relaxation time / trace | bias k (%) | scatter k | bias / scatter: fit"
        " | posterior's median | 68 % k: fit, posterior | bias γ (%) | 68 % γ: fit, posterior"
        " | k not identified (%)",
        lines,
    )


def recording_forces_table(outcomes: Sequence[Outcome]) -> str:
    """Forces of whole recordings by corner frequency and axis."""
    rows = pd.DataFrame([row for outcome in outcomes for row in outcome.forces])
    groups: list[tuple[str, pd.DataFrame]] = [("all", rows)]
    groups += [
        (f"corner {low:g} to {high:g} Nyquist", rows[(rows.corner >= low) & (rows.corner < high)])
        for low, high in itertools.pairwise(CORNER_BANDS)
    ]
    groups += [
        (
            f"{low:g} to {high:g} relaxation times",
            rows[(rows.relaxations >= low) & (rows.relaxations < high)],
        )
        for low, high in itertools.pairwise(RELAXATION_BANDS)
    ]
    groups += [
        ("one of x and y, bead held", rows[(rows.axis == SHARED) & ~rows.rotation]),
        ("one of x and y, bead turns", rows[(rows.axis == SHARED) & rows.rotation]),
        ("x by itself", rows[rows.axis == "x"]),
        ("y by itself", rows[rows.axis == "y"]),
    ]
    lines = []
    for name, group in groups:
        got = group[group.measured]
        if got.empty:
            continue
        lines.append([
            name, str(len(group)), percent(group.refused),
            percent(~group.measured & ~group.refused),
            percent(got.holds_68), percent(got.holds_95),
            f"{got.pull.mean():+.2f}", f"{got.pull.std():.2f}",
            bias(got.ln_error), f"{rms(got.ln_error):.1%}",
        ])  # fmt: skip
    return table(
        "forces | number | refused (%) | not identified (%) | within 68 % (%) | within 95 % (%)"
        " | mean pull | scatter of pulls | bias (%) | rms error",
        lines,
    )


def flags_table(outcomes: Sequence[Outcome], plateaus: int) -> str:
    """How often each flag is raised, per plateau and per recording."""
    per_plateau = Counter(
        (code, severity) for outcome in outcomes for code, severity, _ in outcome.flags
    )
    per_recording = Counter(
        key
        for outcome in outcomes
        for key in {(code, severity) for code, severity, _ in outcome.flags}
    )
    n = len(outcomes)
    return table(
        "flag | severity | plateaus (%) | recordings (%)",
        [
            [code, severity, f"{100 * count / (n * plateaus):.1f}",
             f"{100 * per_recording[code, severity] / n:.1f}"]
            for (code, severity), count in per_plateau.most_common()
        ],
    )  # fmt: skip


def verdicts_table(outcomes: Sequence[Outcome]) -> str:
    """Verdicts, apart for recordings in which the corner frequency is truly too high, or not."""
    lines = []
    for name, group in (
        ("at most one plateau beyond 0.8 Nyquist", [o for o in outcomes if o.fast_plateaus < 2]),
        ("more", [o for o in outcomes if o.fast_plateaus >= 2]),
    ):
        lines.append(
            [name, str(len(group))]
            + [
                percent([o.verdict == v for o in group])
                for v in ("unchecked", "caution", "refused")
            ]
        )
    verdicts = table("recordings | number | unchecked (%) | caution (%) | refused (%)", lines)
    reasons = Counter(reason for outcome in outcomes for reason in set(outcome.reasons))
    return (
        verdicts
        + "\n\n"
        + table(
            "reason given | recordings (%)",
            [[why, f"{100 * n / len(outcomes):.1f}"] for why, n in reasons.most_common()],
        )
    )


def lengths_table(outcomes: Sequence[Outcome]) -> str:
    """Contour and persistence lengths against their truth."""
    rows = pd.DataFrame(
        [length for outcome in outcomes for length in outcome.lengths],
        columns=["name", "ln_error", "pull", "holds"],
    )
    return table(
        "length | fitted in (%) | within 68 % (%) | mean pull | scatter of pulls | bias (%)"
        " | rms error",
        [
            [str(name), f"{100 * len(one) / len(outcomes):.0f}", percent(one.holds),
             f"{one.pull.mean():+.2f}", f"{one.pull.std():.2f}",
             bias(one.ln_error), f"{rms(one.ln_error):.2%}"]
            for name, one in rows.groupby("name")
        ],
    )  # fmt: skip


def challenge_table(answers: Sequence[tuple[list[dict[str, object]], dict[str, Any]]]) -> str:
    """True against measured forces and tethers of the clean cases."""
    if not answers:
        return "The challenge set does not lie beside this checkout: left out."
    rows = pd.DataFrame([row for forces, _ in answers for row in forces])
    lines = [
        [row.case, str(row.plateau), f"{row.true_pN:.3f}", row.axis, _force(row)]
        for row in rows.itertuples()
    ]
    got = rows[rows.measured]
    tethers = [
        [row["case"], f"{row['contour_true']:g}", _length(row["contour"]),
         f"{row['persistence_true']:g}", _length(row["persistence"]), row["chain"],
         _length(row["own_chain_persistence"]),
         row["verdict"], row["reasons"] or "–"]
        for _, row in answers
    ]  # fmt: skip
    return "\n\n".join([
        table(
            "case | plateau | true force (pN) | axis | force, 68 % interval, pull",
            lines,
        ),
        f"{got.holds_68.sum()} of {len(got)} within 68 %, {got.holds_95.sum()} within 95 %, mean "
        f"pull {got.pull.mean():+.2f}, scatter {got.pull.std():.2f}; {len(rows) - len(got)} of "
        f"{len(rows)} without a force.",
        table(
            "case | contour (nm): true | fitted | persistence (nm): true | fitted | chain"
            " | persistence, Marko–Siggia | verdict | reasons",
            tethers,
        ),
    ])  # fmt: skip


def _of(part: str, cases: Sequence[Case]) -> list[Case]:
    return [case for case in cases if case.part == part]


def _rows(case: Case, rows: pd.DataFrame) -> pd.DataFrame:
    return rows[rows.case == case.name]


def rms(errors: pd.Series) -> float:
    """Root mean square."""
    return math.sqrt(float(np.mean(errors**2)))


def bias(errors: pd.Series) -> str:
    """Mean in percent, with its standard error."""
    return f"{100 * errors.mean():+.2f} ± {100 * errors.std() / math.sqrt(len(errors)):.2f}"


def _over_bound(one: pd.DataFrame, name: str) -> str:
    return f"{rms(one[f'{name}_error'] / one[f'{name}_bound']):.2f}"


def _holding(one: pd.DataFrame, name: str) -> str:
    return ", ".join(percent(one[f"{name}_{by}_holds"]) for by in ("fit", "posterior"))


def percent(which: pd.Series | list[bool]) -> str:
    """Share of what is true in percent; a dash where there is nothing."""
    return f"{100 * float(np.mean(which)):.1f}" if len(which) else "–"


def _force(row: Any) -> str:
    if not row.measured:
        return "refused" if row.refused else "not identified"
    return f"{row.value_pN:.3f} ({row.low_pN:.3f}–{row.high_pN:.3f}), {row.pull:+.1f}"


def _length(one: Any) -> str:
    return "–" if one is None else f"{one.value:.4g} ({one.interval[0]:.4g}–{one.interval[1]:.4g})"
