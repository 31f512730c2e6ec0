"""Why a recording is not what its configured experiment would have given.

Effects of the catalogue are fitted one at a time to all traces together; the one that gains most is
kept if it earns its parameters, and the search goes on from there until the battery no longer
objects or nothing helps. Each effect kept is then asked again whether the others could do without
it. Effects that the recording cannot tell from the one named are listed beside it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.configured.fit import ConfiguredFit
from mtpipe.configured.hypotheses import Tried, looking_ahead, together, try_effects
from mtpipe.corrections.catalogue import CORRECTIONS
from mtpipe.corrections.correction import Correction
from mtpipe.corrections.retraced import with_positions
from mtpipe.crosschecking.case import Case, preference
from mtpipe.crosschecking.check import BeadCheck, check_bead
from mtpipe.diagnosis.evidence import evidence_of
from mtpipe.diagnosis.misfit import explained_share, heldout_gain
from mtpipe.diagnosis.refit import (
    begun_again,
    best_formula,
    other_formulas,
    with_forces_found,
)
from mtpipe.diagnosis.unexplained import Rejected, Unexplained, unexplained
from mtpipe.effects.catalogue import catalogue
from mtpipe.effects.effect import Effect
from mtpipe.errors import FitError
from mtpipe.physics.camera import FloatArray

# Chance of a false alarm that is accepted per bead.
ALARM_P = 0.004
# Net gain (nats, BIC) from which an effect is seen although the battery is silent, and from which
# one is kept at all. With a penalty of 5 nats a gain of 8 is needed, which comes by chance once in
# 16 000 tries of one parameter (χ² above 16); the catalogue tries some 30.
SEEN_NATS, KEPT_NATS = 4.0, 3.0
# Where the battery is as content as this with an effect, a second one has to gain so much: the form
# of the first is known only so well, and what is left of it may look like another.
CONTENT_P, BESIDE_NATS = 0.3, 10.0
# Two effects that fit equally well within so many nats cannot be told apart, whatever their numbers
# cost, nor can two whose net gains differ by less; by so many more, one is certain.
ALIKE_NATS, CERTAIN_NATS = 3.0, 50.0
MOST_EFFECTS = 3
# So many effects are checked at most before the search ends, and one is rejected if with it ln p is
# larger than this many times what it was.
MOST_CANDIDATES, MORE_ODD = 3, 1.25
# An effect is named beside an unexplained rest only if it explains so much of the misfit, in ln
# likelihood and in ln p.
MOST_OF_IT = 0.7
# A correction is kept where ln p falls to this share.
MOST_OF_THE_ODDITY = 0.5
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another effect fitted in a named one's place; `nats` : its net gain less that one's there."""

    found: Tried
    nats: float


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that is named.

    Attributes
    ----------
    found : its fit, the effects named before it included, or the correction of the traces.
    alternatives : effects that the recording cannot tell from it.
    before, after : the check without and with it.
    heldout_gain : ln likelihood gained on time that was not fitted, in nats; nan where the effect
        is none of the spectrum's.
    others : a sentence on what the recording's other beads say of it; empty where it is the bead's
        own affair.
    """

    found: Tried | Correction
    alternatives: tuple[Alternative, ...]
    before: BeadCheck
    after: BeadCheck
    heldout_gain: float
    others: str = ""

    @property
    def equivalent(self) -> tuple[str, ...]:
        """Names of the alternatives."""
        return tuple(other.found.effect.name for other in self.alternatives)

    @property
    def name(self) -> str:
        """As FORMATS section 5 has it."""
        return self.found.effect.name if isinstance(self.found, Tried) else self.found.name


@dataclass(frozen=True, eq=False)
class Explanation:
    """What was found about one bead.

    Attributes
    ----------
    before : check against the configured experiment. after : with the effects named.
    verdict : "consistent", "explained" or "unexplained".
    nearest : the effect that came nearest and why it was rejected, where the verdict is
        "unexplained"; None if none could be tried or no more are named at once.
    """

    before: BeadCheck
    after: BeadCheck
    named: tuple[Named, ...]
    verdict: str
    nearest: Rejected | None

    @property
    def fit(self) -> ConfiguredFit:
        """The fit with the effects named."""
        return self.after.case.fit

    @property
    def force_stderr_pN(self) -> FloatArray:
        """(plateaus,) standard errors of the fit's forces, what alternatives and the chain's other
        formula would make of them included, each with the weight that its ln likelihood after BIC
        has beside the one that was taken.
        """
        variance = self.fit.force_stderr_pN**2
        choices = [
            [(other.found.fit, other.nats) for other in one.alternatives] for one in self.named
        ]
        for choice in [*choices, self._other_formulas]:
            weights = np.exp(np.minimum([nats for _, nats in choice], CERTAIN_NATS))
            for weight, (fit, _) in zip(weights / (1 + weights.sum()), choice, strict=True):
                variance = variance + weight * (fit.force_pN - self.fit.force_pN) ** 2
        return np.asarray(np.sqrt(variance))

    @functools.cached_property
    def _other_formulas(self) -> list[tuple[ConfiguredFit, float]]:
        """Fits with the chain's other formulas, and by how many nats they are to be preferred."""
        mine = preference(self.fit)
        return [(fit, preference(fit) - mine) for fit in other_formulas(self.fit)]

    @functools.cached_property
    def unexplained(self) -> Unexplained | None:
        """Place, size and shape of what is left; None where nothing is."""
        if self.verdict != "unexplained":
            return None
        return unexplained(self.after, self.nearest, beside=bool(self.named))


def explain(
    before: BeadCheck,
    random: np.random.Generator,
    *,
    effects: Sequence[Effect] | None = None,
    progress: Progress | None = None,
) -> Explanation:
    """Look for the cause of what differs from the simulation.

    Parameters
    ----------
    before : the bead's cross-check. effects : default: the whole catalogue.
    """
    say = progress or (lambda step: None)
    effects = catalogue() if effects is None else effects
    say("looking at the course of time")
    corrections, check = _corrected(before, random)
    case = check.case
    named, check, nearest = _searched(check, corrections, effects, random, say)
    if check.p_value < ALARM_P and len(corrections) < len(named):
        say("looking at the course of time again")
        late = _late_corrections(check, corrections, case, random)
        again = (
            _searched(late[-1].after, [*corrections, *late], effects, random, say) if late else None
        )
        if again is not None and again[1].p_value >= ALARM_P:
            case = late[-1].after.case
            named, check, nearest = again
    found_first = len(named)
    named, check = without_superfluous(case, named, check, random)
    dropped = len(named) < found_first
    consistent = not named and before.p_value >= ALARM_P
    verdict = "consistent" if consistent else "unexplained"
    if named and check.p_value >= ALARM_P:
        verdict = "explained"
    else:
        kept = certain(named)
        for left_out in named[len(kept) :][:1]:
            if isinstance(left_out.found, Tried):
                nearest = Rejected(left_out.found, _not_enough(left_out))
        named, check = kept, kept[-1].after if kept else before
    # the last was compared with all others there, unless one of them has gone since
    known = named[-1:] if not dropped else []
    distinct = tuple(
        one if one in known else _with_alternatives(one, named, case, effects) for one in named
    )
    nearest = nearest if verdict == "unexplained" else None
    return Explanation(before, check, distinct, verdict, nearest)


def _searched(
    check: BeadCheck,
    corrections: Sequence[Named],
    effects: Sequence[Effect],
    random: np.random.Generator,
    say: Progress,
) -> tuple[list[Named], BeadCheck, Rejected | None]:
    """Effects found one after the other, the corrections before them, and the check with them; the
    one that was not taken at the end.
    """
    nearest: Rejected | None
    case, fit = check.case, check.case.fit
    named, nearest = list(corrections), None
    while len(named) < MOST_EFFECTS:
        say("trying effects")
        tried = try_effects(fit, effects, evidence_of(check))
        needed = KEPT_NATS if check.p_value < ALARM_P else SEEN_NATS
        if named and check.p_value >= CONTENT_P:
            needed = BESIDE_NATS
        if not tried or tried[0].net < needed:
            nearest = Rejected(tried[0], _too_little(tried[0], needed)) if tried else None
            break
        able = [one for one in tried if one.net >= needed]
        if len(named) == len(corrections) and len(able) > 1:
            say("trying pairs of effects")
            able = looking_ahead(fit, able)
        rejected: list[Rejected] = []
        for one in able[:MOST_CANDIDATES]:
            say(f"checking with {one.effect.name}")
            found = _named(one, tried, check, case, random)
            if isinstance(found, Named):
                break
            rejected.append(found)
        if isinstance(found, Rejected):
            nearest = max(rejected, key=lambda one: one.tried.net)
            break
        named.append(found)
        check, fit = found.after, found.after.case.fit
    return named, check, nearest


def _with_alternatives(
    one: Named, named: Sequence[Named], case: Case, effects: Sequence[Effect]
) -> Named:
    """The effect with what the recording cannot tell from it, given the others that are named."""
    if not isinstance(one.found, Tried):
        return one
    fitted = [other.found for other in named if isinstance(other.found, Tried)]
    others = [other for other in fitted if other is not one.found]
    try:
        without = together(case.fit, others, named[-1].after.case.fit)
    except (FitError, ValueError):
        return replace(one, alternatives=())
    tried = try_effects(without, effects, one.found.evidence)
    own = next((other for other in tried if other.effect.name == one.name), None)
    names = {other.name for other in named}
    return replace(one, alternatives=() if own is None else alike(own, tried, names))


def alike(one: Tried, tried: Sequence[Tried], named: Collection[str]) -> tuple[Alternative, ...]:
    """Effects that are not named and fit as well as this one, by themselves or by their price."""
    return tuple(
        Alternative(other, other.net - one.net)
        for other in tried
        if other.effect.name not in named
        and (abs(other.net - one.net) < ALIKE_NATS or one.gain - other.gain < ALIKE_NATS)
    )


def _corrected(check: BeadCheck, random: np.random.Generator) -> tuple[list[Named], BeadCheck]:
    """Take off what is seen in time and not in spectra, as far as the battery objects less then.

    What is found has passed a test of its own, so the battery need not have objected before.
    """
    named = []
    for find in CORRECTIONS:
        found = find(check)
        if found is None:
            continue
        after = check_bead(found.case, random)
        if after.p_value >= ALARM_P or after.p_value > check.p_value**MOST_OF_THE_ODDITY:
            named.append(Named(found, (), check, after, float("nan")))
            check = after
    return named, check


def _late_corrections(
    check: BeadCheck, corrections: Sequence[Named], case: Case, random: np.random.Generator
) -> list[Named]:
    """Corrections that are of use once effects are there, as they are without these.

    Parameters
    ----------
    check : with effects. case : without them.
    """
    taken = {one.name for one in corrections}
    found = [one for one in _corrected(check, random)[0] if one.name not in taken]
    named: list[Named] = []
    for one in found:
        before = named[-1].after if named else check_bead(case, random)
        without = with_positions(case, one.after.case.positions_nm)
        named.append(replace(one, before=before, after=check_bead(without, random)))
    return named


def _named(
    one: Tried, tried: Sequence[Tried], check: BeadCheck, case: Case, random: np.random.Generator
) -> Named | Rejected:
    """The effect, checked; rejected where recording and simulation differ even more with it."""
    fit = best_formula(begun_again(with_forces_found(one, check).fit))
    one = replace(one, fit=fit, gain=fit.log_likelihood - check.case.fit.log_likelihood)
    heldout = heldout_gain(case, check.case.fit, fit)
    if heldout <= 0:
        return Rejected(one, f"gains {one.gain:.0f} nats, but none on time that was not fitted")
    try:
        after = check_bead(replace(case, fit=fit), random)
    except (FitError, ValueError) as error:
        return Rejected(one, f"gains {one.gain:.0f} nats, but cannot be simulated ({error})")
    if after.p_value < min(ALARM_P, check.p_value**MORE_ODD):
        return Rejected(one, _more_odd(one, check, after))
    return Named(one, alike(one, tried, {one.effect.name}), check, after, heldout)


def _too_little(one: Tried, needed: float) -> str:
    numbers = one.hypothesis.numbers
    gains = f"gains {one.gain:.1f} nats" if one.gain >= 0.05 else "gains nothing"
    return (
        f"{gains}, too little for its "
        f"{'parameter' if numbers == 1 else f'{numbers} parameters'} "
        f"({one.penalty + needed:.1f} are needed)"
    )


def _more_odd(one: Tried, before: BeadCheck, after: BeadCheck) -> str:
    return (
        f"gains {one.gain:.0f} nats, but with it recording and simulation differ even more "
        f"(p {before.p_value:.1g} → {after.p_value:.1g})"
    )


def _not_enough(one: Named) -> str:
    share = max(explained_share(one.before, one.after), 0.0)
    if share < MOST_OF_IT:
        return (
            f"explains {share:.0%} of the misfit, and beside an unexplained rest no cause is named "
            f"that explains less than {MOST_OF_IT:.0%}"
        )
    return (
        f"explains {share:.0%} of the misfit, but leaves what is about as odd "
        f"(p {one.before.p_value:.1g} → {one.after.p_value:.1g})"
    )


def without_superfluous(
    case: Case, named: list[Named], check: BeadCheck, random: np.random.Generator
) -> tuple[list[Named], BeadCheck]:
    """Drop effects that the others make needless.

    Parameters
    ----------
    case : without any effect of the spectrum. named : in the order found. check : with all of them.

    Returns
    -------
    The effects left and the check with them, each effect's checks before and after brought in line.
    """
    fitted = [one.found for one in named if isinstance(one.found, Tried)]
    for one in fitted if len(fitted) > 1 else []:
        rest = [other for other in fitted if other is not one]
        try:
            fit = together(case.fit, rest, check.case.fit)
        except (FitError, ValueError):
            continue
        if check.case.fit.log_likelihood - fit.log_likelihood - one.penalty < KEPT_NATS:
            again = check_bead(replace(case, fit=fit), random)
            if again.p_value >= min(ALARM_P, check.p_value):
                at = next(i for i, other in enumerate(named) if other.found is one)
                left = named[:at] + named[at + 1 :]
                if at < len(left):
                    left[at] = replace(left[at], before=named[at].before)
                left[-1] = replace(left[-1], after=again)
                return without_superfluous(case, left, again, random)
    return named, check


def certain(named: list[Named]) -> list[Named]:
    """The effects that may be named beside an unexplained rest, up to the first that may not."""
    kept: list[Named] = []
    for one in named:
        little = explained_share(one.before, one.after) < MOST_OF_IT
        still_odd = one.after.p_value < one.before.p_value ** (1 - MOST_OF_IT)
        if isinstance(one.found, Tried) and (little or still_odd):
            break
        kept.append(one)
    return kept
