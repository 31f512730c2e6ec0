"""The tables of docs/proof.md, from any number of scores."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from scoring import ALARM, EXACT, FAILED, LOCATED, MISSED, PARTIAL, RIGHT, WRONG, Score, wilson

STRENGTHS = ("faint", "moderate", "clear")
# Plateaus whose force the effect biases by more than this are those that a diagnosis can mend.
BIASED = 0.02
VERDICTS = ("consistent", "explained", "described", "unexplained")
# Share of a force that matters to a user who says nothing (`[report] tolerance`).
TOLERANCE = 0.03
# Edges of the probabilities by which names are counted.
BINS = (0.0, 0.5, 0.8, 0.95, 1.0)
Test = Callable[[Score], bool]


def everything(scores: Sequence[Score]) -> str:
    """All tables, in Markdown."""
    parts = {
        "What is asked, and what was reached": asked(scores),
        "Single effects": singles(scores),
        "Pairs": pairs(scores),
        "Three and four causes": several(scores),
        "Effects outside the catalogue": outsiders(scores),
        "Recordings in which nothing is concealed": alarms(scores),
        "Force": forces(scores),
        "Coverage": coverage(scores),
        "The force to quote, by verdict": by_verdict(scores),
        "How sure names are": reliability(scores),
        "Time and failures": times(scores),
    }
    return "\n\n".join(f"### {title}\n\n{text}" for title, text in parts.items())


def asked(scores: Sequence[Score]) -> str:
    """The project's criteria beside the shares reached, with 95 % intervals (Wilson)."""
    single = [s for s in scores if s.kind == "single"]
    strong = [s for s in single if s.strength != "faint"]
    faint = [s for s in single if s.strength == "faint"]
    outside = [s for s in scores if s.kind == "outside"]
    before, after, _ = errors(scores)
    inside, total = covered(s for s in scores if s.kind != "outside")
    rows = [
        ("clean: false alarms", "≤ 1 %", _share(_of(scores, "clean"), _not_right)),
        ("usual errors: false alarms", "≤ 2 %", _share(_of(scores, "usual errors"), _not_right)),
        ("single, moderate and clear: exactly named", "≥ 95 %", _share(strong, _is(EXACT))),
        ("single, faint: exactly named", "≥ 50 %", _share(faint, _is(EXACT))),
        ("single: a wrong name", "≤ 3 %", _share(single, _is(WRONG))),
        ("pairs: both named, nothing more", "≥ 88 %", _share(_of(scores, "pair"), _is(EXACT))),
        ("three and four causes: of causes, named", "≥ 80 %", _causes_named(scores)),
        ("of all names, wrong", "≤ 2 %", _names_wrong(scores)),
        ("outside: unexplained, at the right place", "≥ 90 %", _share(outside, _is(RIGHT))),
        ("outside: explained by a wrong name", "≤ 3 %", _share(outside, _is(WRONG))),
        ("the same, with nothing listed as equivalent", "", _share(outside, _alone_and_wrong)),
        (
            "force: median error after over before, where biased",
            "≤ 1/3",
            f"{after / before:.2f}" if before > 0 else "–",
        ),
        ("force: within one standard error", "64–72 %", _portion(inside, total)),
    ]
    return _table(("", "asked", "reached"), rows)


def singles(scores: Sequence[Score]) -> str:
    """Identification by effect and strength; what was named instead."""
    single = [s for s in scores if s.kind == "single"]
    rows = []
    for name in [*sorted({s.effects[0] for s in single}), "all"]:
        mine = [s for s in single if name in (s.effects[0], "all")]
        shares = [
            _count([s for s in mine if s.strength == strength], EXACT) for strength in STRENGTHS
        ]
        counts = [str(sum(s.outcome == o for s in mine)) for o in (PARTIAL, LOCATED, MISSED)]
        rows.append(
            (name, *shares, *counts, _names(mine) if name != "all" else _count(mine, WRONG))
        )
    used = sum(s.by_equivalent for s in single)
    named = sum(len(s.named) for s in single)
    listed = sum(s.equivalents for s in single) / named if named else 0.0
    head = ("effect", *STRENGTHS, "in part", "located only", "missed", "wrong names")
    return _table(head, rows) + (
        f"\n\nExactly named of how many. {used} of them are right by an equivalent; a name lists "
        f"{listed:.1f} equivalents on average."
    )


def pairs(scores: Sequence[Score]) -> str:
    """Outcomes of pairs, and every one that was not exactly named."""
    return _together(_of(scores, "pair"))


def several(scores: Sequence[Score]) -> str:
    """Outcomes of three and four causes at once, and every one that was not exactly named."""
    return _together(_of(scores, "several"))


def _together(scores: Sequence[Score]) -> str:
    counts = Counter(s.outcome for s in scores)
    outcomes = (EXACT, PARTIAL, WRONG, LOCATED, MISSED, FAILED)
    rows = [(o, _portion(counts[o], len(scores))) for o in outcomes if counts[o] or o == EXACT]
    other = [
        (" + ".join(s.effects), s.strength, s.verdict, ", ".join(s.named) or "–")
        for s in scores
        if s.outcome != EXACT
    ]
    return "\n\n".join(
        [
            _table(("outcome", "share"), rows),
            _table(("concealed", "the weakest", "verdict", "named"), other),
        ]
    )


def _causes_named(scores: Sequence[Score]) -> str:
    several = _of(scores, "several")
    concealed = sum(len(s.effects) for s in several)
    return _portion(concealed - sum(len(s.left) for s in several), concealed)


def _names_wrong(scores: Sequence[Score]) -> str:
    return _portion(sum(len(s.wrong) for s in scores), sum(len(s.named) for s in scores))


def outsiders(scores: Sequence[Score]) -> str:
    """By effect: verdicts, places, names."""
    outside = _of(scores, "outside")
    rows = []
    for name in [*sorted({s.effects[0] for s in outside}), "all"]:
        mine = [s for s in outside if name in (s.effects[0], "all")]
        counts = [str(sum(s.outcome == o for s in mine)) for o in (RIGHT, LOCATED, WRONG, MISSED)]
        beside = sum(bool(s.named) and s.verdict == "unexplained" for s in mine)
        names = _names(mine) if name != "all" else ""
        rows.append((name, str(len(mine)), *counts, str(beside), names))
    head = (
        "effect", "recordings", "unexplained, right place", "unexplained, elsewhere",
        "explained by a name", "not noticed", "a name beside unexplained", "names",
    )  # fmt: skip
    return _table(head, rows)


def alarms(scores: Sequence[Score]) -> str:
    """False alarms where nothing is concealed: clean, and with usual errors in the setup."""
    rows = []
    for kind in ("clean", "usual errors"):
        mine = _of(scores, kind)
        said = [
            f"{s.verdict}: {', '.join(s.named) or 'no name'}" for s in mine if s.outcome == ALARM
        ]
        rows.append((kind, _share(mine, _not_right), "; ".join(said) or "–"))
    return _table(("", "false alarms", "what they said"), rows)


def forces(scores: Sequence[Score]) -> str:
    """Relative errors of forces before and after, where the effect biases them, by effect."""
    rows = []
    known = [s for s in scores if s.kind in ("single", "pair", "several")]
    names = sorted({s.effects[0] for s in known if s.kind == "single"})
    groups = [(n, [s for s in known if s.kind == "single" and s.effects[0] == n]) for n in names]
    groups += [
        ("pairs", _of(known, "pair")),
        ("several", _of(known, "several")),
        ("all", known),
    ]
    for name, mine in groups:
        before, after, count = errors(mine)
        if count:
            ratio = f"{after / before:.2f}"
            rows.append((name, str(count), _percent(before), _percent(after), ratio))
    return _table(("effect", "plateaus", "before (%)", "after (%)", "ratio"), rows) + (
        f"\n\nMedians of the relative error over plateaus that the effect biases by more than "
        f"{BIASED:.0%}; the bias is that of the closed forms, not the one found."
    )


def coverage(scores: Sequence[Score]) -> str:
    """Share of forces within one and two standard errors, by kind, by outcome and by chain."""
    groups: list[tuple[str, Sequence[Score]]] = [
        (kind, _of(scores, kind)) for kind in ("clean", "usual errors", "single", "pair", "several")
    ]
    groups.append(("exactly named", [s for s in scores if s.outcome == EXACT]))
    known = [s for s in scores if s.kind != "outside"]
    groups += [
        (f"{chain} chains", [s for s in known if s.chain == chain])
        for chain in ("marko-siggia", "bouchiat")
    ]
    rows = []
    for name, mine in groups:
        one, total = covered(mine)
        two, _ = covered(mine, 2.0)
        shares = (_portion(one, total), _portion(two, total))
        rows.append((name, str(len(mine)), str(total), *shares))
    head = ("", "recordings", "plateaus", "within 1 standard error", "within 2")
    return _table(head, rows) + (
        "\n\nForces of one recording share its faults, so the intervals are too narrow."
    )


def by_verdict(scores: Sequence[Score]) -> str:
    """How true the recommended forces' intervals are, and the limits that verdicts rest on."""
    rows = []
    for verdict in VERDICTS:
        mine = [s for s in scores if s.verdict == verdict]
        one, total = covered(mine)
        off = [abs(f.after) for s in mine for f in s.forces]
        before = [abs(f.before) for s in mine for f in s.forces]
        if total:
            medians = (_percent(float(np.median(before))), _percent(float(np.median(off))))
            rows.append((verdict, str(len(mine)), str(total), *medians, _portion(one, total)))
    head = (
        "verdict", "recordings", "plateaus", "error as configured (%)", "error (%)",
        "within 1 standard error",
    )  # fmt: skip
    left = [s for s in scores if s.verdict == "unexplained"]
    within = [s for s in left if _limit_holds(s, s.bound)]
    small = [s for s in left if s.bound <= TOLERANCE]
    kept = [s for s in small if _limit_holds(s, TOLERANCE)]
    return _table(head, rows) + (
        "\n\nErrors are medians over plateaus. The stated limit of what is unexplained "
        f"(`force_bound_percent`) holds, at every plateau, in {_portion(len(within), len(left))} "
        f"of the unexplained recordings. Those whose limit is below {TOLERANCE:.0%} count as good; "
        f"no force of them is off by more than {TOLERANCE:.0%} in "
        f"{_portion(len(kept), len(small))}."
    )


def reliability(scores: Sequence[Score]) -> str:
    """Of names by their probability, how many are right."""
    names = [one for s in scores for one in s.sure]
    if not names:
        return "These recordings were diagnosed before names had a probability."
    rows = []
    for low, high in itertools.pairwise(BINS):
        mine = [(p, right) for p, right in names if low <= p < high or p == high == 1.0]
        if mine:
            mean = f"{np.mean([p for p, _ in mine]):.3f}"
            rows.append(
                (f"{low:g} to {high:g}", mean, _portion(sum(r for _, r in mine), len(mine)))
            )
    return _table(("probability", "its mean", "right, or by an equivalent"), rows)


def _limit_holds(one: Score, limit: float) -> bool:
    """Whether no force is off by more than a limit and twice its statistical error."""
    return all(
        abs(f.after) <= limit + 2 * math.sqrt(max((f.after / f.pull) ** 2 - limit**2, 0.0))
        for f in one.forces
        if f.pull != 0
    )


def times(scores: Sequence[Score]) -> str:
    """CPU time per recording, and how many failed."""
    seconds = [s.seconds for s in scores] or [math.nan]
    failed = sum(s.outcome == FAILED for s in scores)
    return (
        f"{len(scores)} recordings; {failed} failed. CPU time per recording, from file to answer: "
        f"{np.median(seconds):.0f} s in the median, {np.quantile(seconds, 0.9):.0f} s in nine of "
        f"ten, {max(seconds):.0f} s at most; {sum(s > 60 for s in seconds)} over a minute."
    )


def errors(scores: Iterable[Score]) -> tuple[float, float, int]:
    """Median relative error before and after, of plateaus that the effect biases; their number."""
    biased = [f for s in scores for f in s.forces if abs(f.bias) > BIASED]
    if not biased:
        return math.nan, math.nan, 0
    before = float(np.median([abs(f.before) for f in biased]))
    return before, float(np.median([abs(f.after) for f in biased])), len(biased)


def covered(scores: Iterable[Score], within: float = 1.0) -> tuple[int, int]:
    """How many forces are within so many standard errors, and of how many."""
    pulls = [f.pull for s in scores for f in s.forces]
    return sum(abs(pull) <= within for pull in pulls), len(pulls)


def _of(scores: Iterable[Score], kind: str) -> list[Score]:
    return [s for s in scores if s.kind == kind]


def _is(outcome: str) -> Test:
    return lambda one: one.outcome == outcome


def _not_right(one: Score) -> bool:
    return one.outcome != RIGHT


def _alone_and_wrong(one: Score) -> bool:
    return one.outcome == WRONG and one.equivalents == 0


def _share(scores: Sequence[Score], test: Test) -> str:
    return _portion(sum(test(one) for one in scores), len(scores))


def _portion(hits: int, total: int) -> str:
    if total == 0:
        return "–"
    low, high = wilson(hits, total)
    return f"{100 * hits / total:.1f} % ({100 * low:.0f}–{100 * high:.0f}; {hits} of {total})"


def _count(scores: Sequence[Score], outcome: str) -> str:
    return f"{sum(s.outcome == outcome for s in scores)}/{len(scores)}" if scores else "–"


def _percent(value: float) -> str:
    return f"{100 * value:.2g}"


def _names(scores: Iterable[Score]) -> str:
    counts = Counter(name for s in scores for name in s.wrong)
    return ", ".join(f"{name} ({count})" if count > 1 else name for name, count in counts.items())


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
