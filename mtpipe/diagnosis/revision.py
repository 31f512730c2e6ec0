"""A bead's explanation changed by what the other beads of its recording say.

An effect may be replaced by one that the bead could not tell from it, lose such alternatives, get
its size from the others as a prior, or be excluded. Where the others have it and this bead is not
as they are, weighing begins again with the size that they have. What has changed is checked anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.crosschecking.check import check_bead
from mtpipe.diagnosis.explain import explain
from mtpipe.diagnosis.explanation import Alternative, Explanation, Named, agrees
from mtpipe.diagnosis.heldout import heldout_gain
from mtpipe.diagnosis.pooled import Common, Outcome
from mtpipe.diagnosis.refit import begun_again, best_formula
from mtpipe.diagnosis.unexplained import Rejected
from mtpipe.effects.effect import Effect, Evidence
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit, fit_configured
from mtpipe.joint_fit.hypotheses import FittedEffect, best_of, together


@dataclass(frozen=True)
class Change:
    """What is to be changed of one effect that a bead names.

    Attributes
    ----------
    place : among the named. outcome : of the beads together.
    effect : the shared effect it is about, not always one that the bead knew of.
    told : what the other beads say of it, in words.
    """

    place: int
    outcome: Outcome
    effect: Effect
    told: str

    def known(self, one: Explanation) -> FittedEffect | None:
        """The shared effect as the bead had it there by itself."""
        there = (tried for tried, _ in accounts(one.named[self.place]))
        return next((tried for tried in there if tried.effect.name == self.effect.name), None)


def accounts(named: Named) -> list[tuple[FittedEffect, float]]:
    """Effects of the spectrum that a named one may be, itself first; net nats less its own."""
    if not isinstance(named.found, FittedEffect):
        return []
    return [(named.found, 0.0), *((one.found, float(one.nats)) for one in named.alternatives)]


def coordinate(fit: ConfiguredFit, tried: FittedEffect) -> int:
    """Which of θ is the size of an effect of one parameter."""
    names = [parameter.name for parameter in fit.model.parameters]
    return fit.model.plateaus + names.index(tried.hypothesis.parameters[0].name)


def with_changes(
    one: Explanation, changes: Sequence[Change], random: np.random.Generator
) -> Explanation:
    """The explanation with the changes made.

    Parameters
    ----------
    one : that is not unexplained. changes : none: it stays as it is. random : of simulations.
    """
    for change in changes:
        if not change.outcome.left:
            return _excluded(one, change)
        if change.outcome.beside:
            return _begun_again(one, change, random)
    named = list(one.named)
    for change in changes:
        named[change.place] = _named_by_outcome(named[change.place], change)
    unchecked = replace(one, named=tuple(named))
    switched = [c for c in changes if named[c.place].name != one.named[c.place].name]
    told = {c.place: c.outcome.others for c in changes if c.outcome.others is not None}
    if not switched and not told:
        return unchecked
    try:
        fit = one.fit
        for change in switched:
            named[change.place] = _in_its_place(named, change.place)
            fit = _spectral(named[change.place]).fit
        for place, common in told.items():
            fit = _with_prior(fit, _spectral(named[place]), common)
        after = check_bead(replace(one.after.case, fit=fit), random)
    except (FitError, ValueError):
        after = None
    if after is None or not agrees(after, one.before):
        for change in switched:
            if change.effect.name == one.named[change.place].name:
                return _excluded(one, change)
        # what the others have in common is not imposed on a bead that does not agree with it
        return one if switched else unchecked
    for i in {*(change.place for change in switched), len(named) - 1}:
        named[i] = replace(named[i], after=after)
    return replace(one, named=tuple(named), after=after)


def _named_by_outcome(named: Named, change: Change) -> Named:
    """The effect as it may be named: unchanged if the other beads still allow it, else the best
    that they allow.
    """
    left = {
        tried.effect.name: (tried, net)
        for tried, net in accounts(named)
        if tried.effect.name in change.outcome.left
    }
    name = named.name if named.name in left else change.outcome.left[0]
    found, own = left.pop(name)
    alternatives = tuple(Alternative(tried, net - own) for tried, net in left.values())
    return replace(named, found=found, alternatives=alternatives, others=_sentence(change))


def _sentence(change: Change) -> str:
    if change.effect.name in change.outcome.left:
        return f"All beads share this: {change.told}."
    return f"It is not {change.effect.name}, which all beads would share: {change.told}."


def _spectral(named: Named) -> FittedEffect:
    assert isinstance(named.found, FittedEffect)
    return named.found


def _in_its_place(named: Sequence[Named], place: int) -> Named:
    """An alternative fitted in the place of what was named, and held out, with all others there.

    Raises
    ------
    FitError : it does not apply beside the others, or gains nothing on time that was not fitted.
    """
    fitted = [one for one in named if isinstance(one.found, FittedEffect)]
    case, mine = fitted[0].before.case, _spectral(named[place])
    everything = [_spectral(one) for one in fitted]
    fit = best_formula(begun_again(together(case.fit, everything, mine.fit)))
    without = together(case.fit, [one for one in everything if one is not mine], fit)
    heldout = heldout_gain(case, without, fit)
    if heldout <= 0:
        raise FitError(f"{mine.effect.name} gains nothing in data kept out of the fit")
    found = replace(mine, fit=fit, gain=fit.log_likelihood - without.log_likelihood)
    return replace(named[place], found=found, heldout_gain=heldout)


def _with_prior(fit: ConfiguredFit, tried: FittedEffect, common: Common) -> ConfiguredFit:
    """The fit once more, with what the other beads have in common known beforehand."""
    parameters = list(fit.model.parameters)
    k = coordinate(fit, tried) - fit.model.plateaus
    parameters[k] = replace(parameters[k], prior=(common.value, common.stderr))
    return fit_configured(replace(fit.model, parameters=tuple(parameters)), fit.theta)


def _begun_again(one: Explanation, change: Change, random: np.random.Generator) -> Explanation:
    """Weighed again with the size that the other beads have of a shared effect."""
    known, common = change.known(one), change.outcome.others
    # a bead that did without it by itself may go on doing so
    otherwise = one if known is None else _excluded(one, change)
    first = next(named for named in one.named if isinstance(named.found, FittedEffect))
    case = first.before.case
    mine = known or best_of(case.fit, change.effect, Evidence((), tuple(case.fit.force_pN)))
    if mine is None or common is None:
        return otherwise
    try:
        fit = _with_prior(together(case.fit, [mine], mine.fit), mine, common)
        check = check_bead(replace(case, fit=fit), random)
    except (FitError, ValueError):
        return otherwise
    found = replace(mine, fit=fit, gain=fit.log_likelihood - case.fit.log_likelihood)
    gain = heldout_gain(case, case.fit, fit)
    further = explain(check, random)
    besides = "; this bead has a further cause of its own" if further.named else ""
    others = f"All beads share this; its size is taken from the others{besides}."
    shared = Named(found, (), first.before, check, gain, others)
    named = tuple(other for other in one.named if not isinstance(other.found, FittedEffect))
    named = (*named, shared, *further.named)
    if further.verdict == "unexplained":
        return otherwise
    verdict = "described" if any(other.form for other in named) else "explained"
    return Explanation(one.before, further.after, named, verdict, None)


def _excluded(one: Explanation, change: Change) -> Explanation:
    """Unexplained: what the bead would need, all beads would share, and they have it not."""
    tried = change.known(one)
    assert tried is not None
    kept = [other for other in one.named if not isinstance(other.found, FittedEffect)]
    reason = f"gains {tried.gain:.0f} in ln likelihood, but all beads would share it: {change.told}"
    after = kept[-1].after if kept else one.before
    return Explanation(one.before, after, tuple(kept), "unexplained", Rejected(tried, reason))
