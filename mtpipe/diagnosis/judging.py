"""What simulations say of a set of causes, and of likelihood and simulations together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mtpipe.crosschecking.battery.statistic import Statistic
from mtpipe.crosschecking.check import (
    CLEARLY_NOT,
    ENOUGH,
    BeadCheck,
    check_bead,
    comparable_p_values,
    p_value_but_moments,
)
from mtpipe.diagnosis.causes import Causes, by_score, grown
from mtpipe.diagnosis.explanation import AGREES_P, agrees, ln_of
from mtpipe.diagnosis.single_events import unseen_member
from mtpipe.diagnosis.unexplained import SPECTRAL, Rejected
from mtpipe.diagnosis.why_not import gains_in_words
from mtpipe.effects.effect import Effect, Evidence
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import model_with

# Simulations of a set where 120 speak against it: small p-values of 120 simulations scatter tenfold
# from one draw to the next, of 240 fivefold.
SURE_SIMULATIONS = 240
# Statistics of what likelihood is of: power, what axes have in common, and mean heights.
OF_LIKELIHOOD = (*SPECTRAL, "correlation", "extension", "known_force")
# One statistic of some three hundred is as odd as that by chance in one of thirty thousand.
REFUTED_P = 1e-7
# A member is to blame for a difference of which half or less is left without it.
LEFT_OF_IT = 0.5


def checked_with(
    best: Causes, begun: BeadCheck, first: BeadCheck, random: np.random.Generator
) -> BeadCheck:
    """A set compared with simulations of all of it: by more of them where few speak against it, as
    it is left to chance by few, and how far skewness and kurtosis may scatter is not known by few.
    """
    check = check_bead(replace(begun.case, fit=best.fit), random)
    if agrees(check, first):
        return check
    if max(check.p_value, p_value_but_moments(check)) >= CLEARLY_NOT:
        check = check_bead(check.case, random, rounds=(SURE_SIMULATIONS,), begun=check)
    return check


def judged(one: Causes, check: BeadCheck) -> Causes:
    """The set with what simulations say against it."""
    return replace(one, objection=ln_of(1.0) - ln_of(check.p_value))


def lacked_by(
    best: Causes,
    check: BeadCheck,
    without: ConfiguredFit,
    members: Sequence[Effect],
    evidence: Evidence,
    weighed: dict[frozenset[str], Causes],
) -> Causes | None:
    """The set with the cause or term that it lacks most, where likelihood and simulations together
    speak for that: its score is more than the worth of the set that simulations object to.

    Parameters
    ----------
    best : judged. check : of it. weighed : all sets as yet; new ones are added.
    """
    larger, _ = grown([best], without, members, evidence, weighed)
    larger = [
        one
        for one in larger
        if one.score > best.worth
        and one.fit.log_likelihood - best.fit.log_likelihood > hopeful(check)
    ]
    return max(larger, key=by_score, default=None)


def rejected(best: Causes, why: str) -> Rejected | None:
    """The first cause of a set, which is not named, in words that continue "it …"; None where terms
    are all that it has.
    """
    one = next((one for one in best.members if not one.effect.form), None)
    if one is None:
        return None
    others = [other.effect.name for other in best.members if other is not one]
    beside = f" beside {', '.join(others)}" if others else ""
    return Rejected(one, f"{gains_in_words(one)}, but{beside} {why}")


def better_judged(
    best: Causes,
    check: BeadCheck,
    rivals: Sequence[Causes],
    begun: BeadCheck,
    random: np.random.Generator,
) -> tuple[Causes, BeadCheck, dict[frozenset[str], float]]:
    """Of sets that are nearly as likely, the one that likelihood and battery together speak for
    (as where z may have a bend), with its check; and what simulations say against each of the
    others, more than against the best (nats).
    """
    objections: dict[frozenset[str], float] = {}
    for rival in rivals:
        if rival.score + ln_of(1.0) <= best.score + ln_of(check.p_value):
            continue
        if unseen_member(begun.case, rival, [best], random):
            objections[rival.names] = math.inf
            continue
        try:
            other = check_bead(replace(begun.case, fit=rival.fit), random)
        except (FitError, ValueError):
            objections[rival.names] = math.inf
            continue
        p_best, p_rival = comparable_p_values(check, other)
        objections[rival.names] = ln_of(p_best) - ln_of(p_rival)
        if p_rival >= AGREES_P and rival.score - objections[rival.names] > best.score:
            objections[best.names] = -objections[rival.names]
            best, check = rival, other
    return best, check, objections


def contradicted(
    begun: BeadCheck, causes: Causes, check: BeadCheck, random: np.random.Generator
) -> str:
    """The name of a member by which positions would be distributed, or change in time, as they
    were not recorded: without it, all else as it was fitted, they would not. Empty where there is
    none.

    Of that likelihood knows nothing. What it does know, other causes may mend. Nor is a member to
    blame without which simulations only scatter more.
    """
    odd = {
        statistic: abs(observed - simulated)
        for statistic, p_value, observed, simulated in _compared(check)
        if statistic.kind not in OF_LIKELIHOOD and p_value < REFUTED_P
    }
    for one in causes.members if odd else ():
        rest = [other for other in causes.members if other is not one]
        try:
            model, theta = model_with(begun.case.fit, rest, causes.fit)
            expected = model.all_expected(theta)
            value = model.log_likelihood(expected, theta)
            fewer = ConfiguredFit(model, theta, expected, value, converged=True)
            other = check_bead(replace(begun.case, fit=fewer), random, rounds=(ENOUGH,))
        except (FitError, ValueError):
            continue
        if any(
            p_value > AGREES_P and abs(observed - simulated) < LEFT_OF_IT * odd[statistic]
            for statistic, p_value, observed, simulated in _compared(other)
            if statistic in odd
        ):
            return one.effect.name
    return ""


def _compared(check: BeadCheck) -> Iterator[tuple[Statistic, float, float, float]]:
    """Of each statistic its p-value, what was recorded and the mean of simulations."""
    means = check.simulated.mean(axis=0)
    return zip(check.statistics, check.p_values, check.observed, means, strict=True)


def hopeful(check: BeadCheck) -> float:
    """What a member has to gain if two more such may mend what the battery objects to (nats): none
    mends more than it gains.
    """
    return 0.5 * math.log(AGREES_P / max(check.p_value, 1e-300))
