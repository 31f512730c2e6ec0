"""Fits of hypotheses: the configured experiment with one more effect."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.changes import by_formula
from mtpipe.experiment.parameter import already_free
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import number
from mtpipe.joint_fit.distance import missing_nats
from mtpipe.joint_fit.fit import MOST_ROUNDS, ConfiguredFit, exchanged, first_guess, fit_configured
from mtpipe.joint_fit.model import ConfiguredModel

# Rounds of the first fit of each hypothesis, and nats to which fits of hypotheses converge.
FIRST_ROUNDS, TRIED_NATS = 3, 0.05
# Fewest events that spectra can speak of: their number scatters by a third.
FEWEST_EVENTS = 10
# A hypothesis is given up if its gain is 30 nats and 60 % below the best.
WORTHWHILE_NATS, WORTHWHILE_SHARE = 30.0, 0.6
# Misfit of heights, in standard errors, from which they are out of the tether's reach. A fresh fit
# has gone astray if it is worse than before by more than a tenth of the whole misfit.
FAR_FROM_IT, LOST_SHARE = 8.0, 0.1


@dataclass(frozen=True, eq=False, repr=False)
class FittedEffect:
    """An effect with its best hypothesis fitted.

    Attributes
    ----------
    gain : rise of ln likelihood over the fit without the effect.
    penalty : what its numbers cost, half as many times ln of the number of ordinates (BIC), and
        what its form was chosen from; of sizes that do not earn that, what the fit would lose
        without them.
    evidence : that the hypotheses began with. index : which of them this is.
    """

    effect: Effect
    hypothesis: Hypothesis
    fit: ConfiguredFit
    gain: float
    penalty: float
    evidence: Evidence
    index: int

    def __repr__(self) -> str:
        return f"FittedEffect {self.effect.name}: net gain {number(self.net, 2)} nats"

    @property
    def net(self) -> float:
        """Gain less penalty, in nats; half of −ΔBIC."""
        return self.gain - self.penalty

    @property
    def shared(self) -> bool:
        """Whether all beads of a recording have it alike."""
        return self.effect.shared and not self.hypothesis.own


def with_hypothesis(
    fit: ConfiguredFit, hypothesis: Hypothesis, *, rounds: int = MOST_ROUNDS, afresh: bool = False
) -> ConfiguredFit:
    """Fit a hypothesis, beginning where the fit without it stands.

    Parameters
    ----------
    afresh : whether the fit is begun afresh too; the better of both is taken.
    """
    model = replace(
        fit.model,
        experiment=hypothesis.experiment,
        parameters=(*fit.model.parameters, *hypothesis.parameters),
    )
    start = np.concatenate([fit.theta, [p.start for p in hypothesis.parameters]])
    begun = fit_configured(model, start, rounds=rounds, arrived=TRIED_NATS)
    if not afresh:
        return begun
    try:
        fresh = fit_configured(model, first_guess(model), rounds=rounds, arrived=TRIED_NATS)
    except (FitError, ValueError):
        return begun
    return max(begun, fresh, key=lambda one: one.log_likelihood)


def worth_beginning_afresh(fit: ConfiguredFit, *, beside: bool) -> bool:
    """Whether hypotheses are begun afresh too, and not only where the fit without them stands.

    Forces and noise of the fit without them are a poor start if that experiment cannot reach the
    recorded heights. A fit that has an effect already found its forces with it; if that fit ends
    far lower when begun afresh, so would fits with one effect more.

    Parameters
    ----------
    beside : whether the fit has an effect already.
    """
    if np.abs(fit.height_pulls).max() < FAR_FROM_IT:
        return False
    if not beside:
        return True
    try:
        fresh = fit_configured(
            fit.model, first_guess(fit.model), rounds=FIRST_ROUNDS, arrived=TRIED_NATS
        )
    except (FitError, ValueError):
        return True
    return fit.log_likelihood - fresh.log_likelihood < LOST_SHARE * missing_nats(fit)


def happens(one: FittedEffect) -> bool:
    """Whether an effect of single events, as it is fitted, has enough of them in the recording for
    spectra to be like their mean; of any other effect, True.
    """
    if one.effect.events is None:
        return True
    model = one.fit.model
    duration_s = [data.duration_s for data in model.data]
    experiment = model.described(one.fit.theta)
    return one.effect.events(experiment, one.fit.force_pN.tolist(), duration_s) >= FEWEST_EVENTS


def gained_by_motion(one: FittedEffect) -> float:
    """ln likelihood that an effect gains by moving over all of it standing still (nats).

    inf for an effect that does not move, or that does not apply when it stands still.
    """
    if one.effect.still is None:
        return math.inf
    fit = one.fit
    still = one.effect.still(fit.model.described(fit.theta))
    others = range(len(fit.model.parameters) - len(one.hypothesis.parameters))
    try:
        without = exchanged(fit, still.experiment, others, still.parameters)
    except (FitError, ValueError):
        return math.inf
    return fit.log_likelihood - without.log_likelihood


def together(
    fit: ConfiguredFit, chosen: Sequence[FittedEffect], start: ConfiguredFit
) -> ConfiguredFit:
    """Fit several effects at once, their parameters beginning where another fit has them.

    Parameters, raises: as `model_with`.
    """
    return fit_configured(*model_with(fit, chosen, start))


def model_with(
    fit: ConfiguredFit, chosen: Sequence[FittedEffect], start: ConfiguredFit
) -> tuple[ConfiguredModel, FloatArray]:
    """The model with several effects at once, and where another fit has its coordinates.

    Parameters
    ----------
    fit : without any of them. start : where forces and parameters begin, as far as it has them,
        and whose formula of the chain is taken.

    Raises
    ------
    FitError : one does not apply together with the others.
    """
    model, formula = fit.model, start.model.experiment.chain.formula_without_stretching
    model = replace(model, experiment=by_formula(model.experiment, formula))
    for one in chosen:
        hypotheses = one.effect.hypotheses(model.experiment, one.evidence)
        if not hypotheses:
            raise FitError(f"{one.effect.name} does not apply together with the others")
        hypothesis = hypotheses[min(one.index, len(hypotheses) - 1)]
        model = replace(
            model,
            experiment=hypothesis.experiment,
            parameters=(*model.parameters, *hypothesis.parameters),
        )
    plateaus = start.model.plateaus
    known = {
        parameter.name: float(value)
        for other in (*(one.fit for one in chosen), start)
        for parameter, value in zip(other.model.parameters, other.theta[plateaus:], strict=True)
    }
    values = [known.get(parameter.name, parameter.start) for parameter in model.parameters]
    return model, np.concatenate([start.theta[:plateaus], values])


def try_effects(
    fit: ConfiguredFit,
    effects: Sequence[Effect],
    evidence: Evidence,
    *,
    beside: bool = False,
    only: Mapping[str, Collection[int]] | None = None,
) -> list[FittedEffect]:
    """Fit every effect that applies, each with the best of its hypotheses; best first.

    All begin with a few steps; those that have gained something like the best are then fitted to
    the end, the others stay where they are.

    Parameters
    ----------
    beside : whether the fit has an effect already.
    only : which hypotheses of an effect, by its name; of others: all.
    """
    begun: list[FittedEffect] = []
    afresh = worth_beginning_afresh(fit, beside=beside)
    for effect in effects:
        hypotheses = effect.hypotheses(fit.model.experiment, evidence)
        wanted = (only or {}).get(effect.name, range(len(hypotheses)))
        for index, hypothesis in enumerate(hypotheses):
            if index not in wanted or already_free(fit.model.parameters, hypothesis.parameters):
                continue
            try:
                fitted = with_hypothesis(fit, hypothesis, rounds=FIRST_ROUNDS, afresh=afresh)
            except (FitError, ValueError):
                continue
            gain, price = fitted.log_likelihood - fit.log_likelihood, penalty(fit, hypothesis)
            begun.append(FittedEffect(effect, hypothesis, fitted, gain, price, evidence, index))
    best = max((one.gain for one in begun), default=0.0)
    worthwhile = best - max(WORTHWHILE_NATS, WORTHWHILE_SHARE * best)
    strongest: dict[str, FittedEffect] = {}
    for one in begun:
        if one.gain > worthwhile:
            try:
                one = idle_sizes_forgiven(_ended(one, fit), fit)
            except FitError:
                # it ended where the least change leaves the bead on the surface
                continue
        if one.effect.name not in strongest or one.net > strongest[one.effect.name].net:
            strongest[one.effect.name] = one
    return sorted(strongest.values(), key=lambda one: one.net, reverse=True)


def penalty(fit: ConfiguredFit, hypothesis: Hypothesis) -> float:
    """What the numbers of a hypothesis cost beside a fit, in nats (`FittedEffect.penalty`)."""
    numbers = 0.5 * hypothesis.numbers * math.log(fit.model.ordinates)
    return numbers + math.log(hypothesis.chosen_from) + hypothesis.learned_nats


def best_of(fit: ConfiguredFit, effect: Effect, evidence: Evidence) -> FittedEffect | None:
    """One effect with the best of its hypotheses; None where none applies or can be fitted."""
    tried = try_effects(fit, [effect], evidence)
    return tried[0] if tried else None


def lost_without(fit: ConfiguredFit, hypothesis: Hypothesis) -> float:
    """Least loss of ln likelihood when the sizes of one of a fit's hypotheses are set to 0, for a
    parabolic likelihood (Wald 1943, Trans. Am. Math. Soc. 54, 426).
    """
    sizes = {one.name for one in hypothesis.parameters if one.lower == 0 or one.start == 0}
    model = fit.model
    index = [model.plateaus + k for k, p in enumerate(model.parameters) if p.name in sizes]
    covariance, size = fit.covariance[np.ix_(index, index)], fit.theta[index]
    stderr = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    pulls = size / stderr
    correlation = covariance / np.outer(stderr, stderr)
    return 0.5 * float(pulls @ np.linalg.lstsq(correlation, pulls, rcond=1e-9)[0])


def idle_sizes_forgiven(one: FittedEffect, without: ConfiguredFit) -> FittedEffect:
    """The effect with a lower penalty: sizes that gain less than they cost are not charged for.

    Only sizes with a lower bound of 0, which is no effect, can be idle. The fit keeps them, so that
    its errors allow for them as before.
    """
    model = one.fit.model
    first = len(model.parameters) - len(one.hypothesis.parameters)
    each_costs = (one.penalty - math.log(one.hypothesis.chosen_from)) / one.hypothesis.numbers
    if one.gain < each_costs:
        return one
    stderr = np.sqrt(np.maximum(np.diag(one.fit.covariance), 1e-300))[model.plateaus :]
    worth = {
        k: 0.5 * float(one.fit.theta[model.plateaus + k] / stderr[k]) ** 2
        for k in range(first, len(model.parameters))
        if model.parameters[k].lower == 0
    }
    idle = {k for k, nats in worth.items() if nats < each_costs}
    if idle and idle == set(worth):
        idle.remove(max(worth, key=lambda k: worth[k]))
    if not idle:
        return one
    experiment = model.experiment
    for k in idle:
        experiment = model.parameters[k].change(experiment, 0.0)
    kept = [k for k in range(len(model.parameters)) if k not in idle]
    try:
        fewer = exchanged(one.fit, experiment, kept)
        if fewer.log_likelihood > one.fit.log_likelihood:
            # the fit with all sizes had stopped too early
            one = _begun_where(one, fewer, kept, without)
    except (FitError, ValueError):
        return one
    lost = max(one.fit.log_likelihood - fewer.log_likelihood, 0.0)
    return replace(one, penalty=min(one.penalty, one.penalty - each_costs * len(idle) + lost))


def _begun_where(
    one: FittedEffect, fewer: ConfiguredFit, kept: Sequence[int], without: ConfiguredFit
) -> FittedEffect:
    """The effect fitted from where the fit with only the sizes that were kept stands."""
    model, plateaus = one.fit.model, one.fit.model.plateaus
    start = np.concatenate([fewer.theta[:plateaus], np.zeros(len(model.parameters))])
    start[plateaus + np.asarray(kept, int)] = fewer.theta[plateaus:]
    fitted = fit_configured(model, start, arrived=TRIED_NATS)
    return replace(one, fit=fitted, gain=fitted.log_likelihood - without.log_likelihood)


def _ended(one: FittedEffect, without: ConfiguredFit) -> FittedEffect:
    if one.fit.converged:
        return one
    try:
        fitted = fit_configured(one.fit.model, one.fit.theta, arrived=TRIED_NATS)
    except (FitError, ValueError):
        return one
    return replace(one, fit=fitted, gain=fitted.log_likelihood - without.log_likelihood)
