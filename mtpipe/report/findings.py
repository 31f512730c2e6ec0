"""What was found, before everything else: a sentence for each bead, and for the recording.

Read from the run folder alone; index, bead pages and the terminal say the same.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mtpipe.ground.notice import Notice
from mtpipe.report import words
from mtpipe.report.crosscheck_words import place_in_words
from mtpipe.report.folder import RunFolder, records
from mtpipe.report.notices import told_once
from mtpipe.report.plateau_forces import largest_change, quoted
from mtpipe.report.remedies import remedy, stated

HEADLINES = {
    "consistent": "The recording agrees with its simulation.",
    "explained": "The recording differs from the setup, and the cause was found.",
    "described": "The recording differs from the setup. No known cause explains all of it, but "
    "terms of known form describe it.",
    "unexplained": "The recording differs from its simulation, and the cause is not known.",
    "unchecked": "Not checked against a simulation.",
    "refused": "This bead gives no force.",
}
PARTLY = "The recording differs from its simulation. What was found explains a part of it."
DIFFERENT = ("explained", "described", "unexplained")
# Statistics of the cross-check that are about the spectrum or what follows from it.
OF_SPECTRA = ("psd_band", "allan_variance", "stiffness", "friction", "stiffness_along_series",
              "friction_along_series")  # fmt: skip
# Recorded power below this share of the expected is as good as none.
SMALLEST_FACTOR = 0.01
# Changes of a force by less than this are not worth a line.
SMALLEST_CHANGE = 0.005
UNCHECKED = "Even a good fit gives a wrong force if the experiment was not as the setup states it."
NO_FORCE = "The fit gives no force to quote."
MIXED = "The plateau mixes several states and gives no force."
VERDICT_BEADS = {
    "good": "good beads",
    "unchecked": "unchecked beads",
    "caution": "beads with caution",
    "refused": "refused beads",
}


@dataclass(frozen=True)
class Finding:
    """What was found about a bead, in the order in which it matters.

    Attributes
    ----------
    kind : a key of `HEADLINES`.
    named : whether a cause or a term is among the details.
    details : what, where and how large.
    note : what it may do to the forces; empty where nobody looked.
    forces : range of the forces to quote; empty where there is none.
    source : where these forces come from, in words.
    change : force as configured and to quote, where they differ most; empty where they do not.
    reasons : why the verdict is not a better one.
    actions : what to do about it.
    """

    kind: str
    named: bool
    details: tuple[str, ...]
    note: str
    forces: str
    source: str
    change: str
    reasons: tuple[str, ...]
    actions: tuple[str, ...]

    @property
    def headline(self) -> str:
        """The finding in one sentence, or two short ones, the same for all beads of a kind."""
        return PARTLY if self.kind == "unexplained" and self.named else HEADLINES[self.kind]


def bead_finding(run: RunFolder, bead: Mapping[str, Any]) -> Finding:
    """The finding about a bead.

    Parameters
    ----------
    bead : row of `beads`.
    """
    name, mismatch = bead["bead"], words.text(bead["mismatch"])
    kind = "refused" if bead["verdict"] == "refused" else mismatch or "unchecked"
    found: Mapping[str, Any] = run.mismatch["beads"].get(name, {})
    forces = run.forces[run.forces["bead"] == name]
    given = quoted(forces)
    sources = [words.SOURCE.get(code, words.text(code)) for code in given["force_source"].unique()]
    reasons = tuple(words.sentence(r) for r in words.text(bead["reasons"]).split("|") if r.strip())
    if mismatch in DIFFERENT:
        # the first is of the diagnosis (mtpipe.pipeline.verdict_diagnosed): more of it is said here
        reasons = reasons[1:]
    return Finding(
        kind=kind,
        named=any(found.get(part) for part in ("effects", "terms")),
        details=reasons
        if kind == "refused"
        else _details(run, name, found, has_force=len(given) > 0),
        note="" if kind == "refused" else _note(bead, mismatch, run.setup.report.tolerance),
        forces=words.span(given["force_pN"].min(), given["force_pN"].max()) if len(given) else "",
        source=words.listed(sources),
        change=_change(forces),
        reasons=() if kind == "refused" else reasons,
        actions=_actions(run, name, kind, found, doubted=bool(reasons)),
    )


def overview(verdicts: Iterable[str]) -> str:
    """How many beads there are of each verdict."""
    counts = Counter(verdicts)
    parts = [f"{counts[name]} {name}" for name in VERDICT_BEADS if counts[name]]
    return f"{words.count(counts.total(), 'bead')}: {', '.join(parts)}."


def overall_forces(run: RunFolder) -> str:
    """Range of the forces to quote of the beads with the best verdict that have any."""
    given = quoted(run.forces).merge(run.beads[["bead", "verdict"]], on="bead")
    for name in VERDICT_BEADS:
        forces = given.loc[given["verdict"] == name, "force_pN"]
        if len(forces):
            span = words.span(forces.min(), forces.max())
            return f"Forces to quote of {VERDICT_BEADS[name]}: {span} pN."
    return "No bead has a force."


def mixed_plateaus(run: RunFolder) -> list[str]:
    """Sentences on plateaus that mix states and give no force, each with the beads concerned."""
    told = {(n.bead, n.plateau): n.message for n in run.notices if n.code == "not_one_state"}
    mixed = run.forces[run.forces["status"] == "not_one_state"]
    places = [
        (row["bead"], int(row["plateau"]))
        for row in records(mixed.drop_duplicates(["bead", "plateau"]))
    ]
    notices = [
        Notice("not_one_state", "warning", told.get(place, MIXED), *place) for place in places
    ]
    return [f"{words.few(one.beads)}, {one.place}: {one.message}" for one in told_once(notices)]


def _details(
    run: RunFolder, bead: str, found: Mapping[str, Any], *, has_force: bool
) -> tuple[str, ...]:
    if not found:
        fitted = UNCHECKED if has_force else NO_FORCE
        return (_unsimulated(run, bead) or f"{fitted} {_finds_out(run)}",)
    sentences = [one["sentence"] for one in (*found["effects"], *found["terms"])]
    if found["verdict"] == "unexplained":
        sentences += _left(run, bead, found["located"])
    return tuple(sentences)


def _unsimulated(run: RunFolder, bead: str) -> str:
    """Why a bead could not be simulated; empty where nobody tried."""
    codes = ("not_crosschecked", "crosscheck_failed")
    return next((n.message for n in run.notices_of(bead) if n.code in codes), "")


def _finds_out(run: RunFolder) -> str:
    """What to do about beads that nobody has cross-checked yet."""
    if any(n.code == "crosscheck_to_come" for n in run.notices):
        return "The cross-check is still to come."
    return "To check this, run mtpipe again without --no-crosscheck."


def _left(run: RunFolder, bead: str, located: Sequence[Mapping[str, Any]]) -> list[str]:
    """Where and how large the clearest part is of what no cause explains."""
    if not located:
        return []
    place = clearest_place(run, bead)
    if place is None:
        return [
            f"The clearest difference: {place_in_words(located[0])}{_size(run, bead, located[0])}."
        ]
    axis, one = place
    low, high = (words.number(edge, 2) for edge in one["band_hz"])
    where = "" if one["plateau"] is None else f" in plateau {one['plateau']}"
    return [
        f"The clearest difference: along {axis} between {low} and {high} Hz{where} the recorded "
        f"power is {_as_much(one['factor'], one['factor_stderr'])}."
    ]


def clearest_place(run: RunFolder, bead: str) -> tuple[str, Mapping[str, Any]] | None:
    """Axis and place of the clearest correction of a spectrum; None where it is not the finding.

    It is where the most significant difference is one of power or of what follows from it.
    """
    left = run.unexplained.get(bead)
    located = run.mismatch["beads"][bead]["located"]
    if left is None or left["correction"] is None or not located:
        return None
    axes = [(one["axis"], place) for one in left["correction"]["axes"] for place in one["places"]]
    if located[0]["statistic"] not in OF_SPECTRA or not axes:
        return None
    return max(axes, key=lambda pair: abs(pair[1]["factor"] - 1) / pair[1]["factor_stderr"])


def _size(run: RunFolder, bead: str, located: Mapping[str, Any]) -> str:
    """What was recorded and simulated where a statistic differs most."""
    table = run.crosscheck
    same = table[
        (table["bead"] == bead)
        & (table["statistic"] == located["statistic"])
        & (table["axis"] == located["axis"])
    ]
    if same.empty:
        return ""
    row = records(same.sort_values("p_value", kind="stable").head(1))[0]
    value, low, high = (
        words.number(row[name], 2) for name in ("value", "simulated_low", "simulated_high")
    )
    return f": {value}, simulated {low} to {high}"


def _as_much(factor: float, stderr: float) -> str:
    """A factor on the power in words: in percent where it is near 1."""
    if 0.5 < factor < 2:
        side = "above" if factor > 1 else "below"
        return f"{words.with_error(100 * abs(factor - 1), 100 * stderr)} % {side} the expected"
    if factor < SMALLEST_FACTOR:
        return f"less than {SMALLEST_FACTOR} times the expected"
    return f"{words.with_error(factor, stderr)} times the expected"


def _note(bead: Mapping[str, Any], mismatch: str, tolerance: float) -> str:
    """What the mismatch does to the forces, beside the tolerance of the setup's `[report]`."""
    if mismatch not in DIFFERENT:
        return ""
    bound, most = bead["force_bound_percent"], words.number(100 * tolerance)
    if not bead["material"]:
        if mismatch == "unexplained":
            # forces as configured may differ by much more: they are not those to quote
            return (
                f"What is not explained may move a force to quote by up to {words.number(bound, 2)}"
                f" %. That is within the tolerance of {most} %."
            )
        return f"The mismatch is significant but moves no force by more than {most} %."
    if mismatch == "explained":
        return ""
    if not words.is_number(bound):
        return "By how much what is not explained may move a force is not known."
    return f"What is not explained may move a force by up to {words.number(bound, 2)} %."


def _change(forces: Any) -> str:
    change = largest_change(forces)
    if change is None or abs(change.ratio - 1) < SMALLEST_CHANGE:
        return ""
    magnet = (
        f" ({words.number(change.magnet_mm, 4)} mm)" if words.is_number(change.magnet_mm) else ""
    )
    before = words.with_error(change.before, change.before_stderr)
    after = words.with_error(change.after, change.after_stderr)
    return (
        f"{before} → {after} pN in plateau {change.plateau}{magnet}, {words.change(change.ratio)}"
    )


def _actions(
    run: RunFolder, bead: str, kind: str, found: Mapping[str, Any], *, doubted: bool
) -> tuple[str, ...]:
    if kind == "refused":
        return ("Leave this bead out.",)
    if kind == "consistent":
        if doubted:
            return ("Settle the points above before you use the forces.",)
        return ("Use the forces as they are.",)
    if kind == "unchecked":
        if _unsimulated(run, bead):
            return ("Add what is missing to the recording or the setup. Then run mtpipe again.",)
        return (_finds_out(run),)
    named = tuple(
        f"{words.label(one['effect']).capitalize()}: {remedy(one['effect'])}"
        f"{stated(one['effect'], run.setup)}"
        for one in found["effects"]
    )
    if kind == "explained":
        return (*named, "Then run mtpipe again.")
    return (
        *named,
        "Find in the map below the axis, plateaus and frequencies at which it differs. What in the "
        "experiment changed there?",
        "Compare with the other beads: what all of them show comes from the instrument.",
    )
