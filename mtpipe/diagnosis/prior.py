"""What causes cost before any data, and what all of them together are worth beside a fit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.special import logsumexp

from mtpipe.effects.catalogue import OWN, catalogue
from mtpipe.effects.effect import Effect, Evidence
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import penalty, try_effects
from mtpipe.joint_fit.score_test import promised_gain

# Prior odds of a cause outside the catalogue against one inside it.
UNKNOWN = 0.05
# Prior cost of a cause, in nats: each effect of the catalogue is taken for equally likely.
CAUSE_NATS = math.log(len(OWN))
# Nats that a term costs: 10 more than a name, as a form with a free law in the force fits more
# recordings than physics does.
TERM_NATS = CAUSE_NATS + 10.0
# Causes that are fitted beside a fit, to know its weight with them.
MOST_FITTED = 3
# Decimals of their weight in nats: fits end within 0.05 nats of their best, and last bits, which
# depend on what was computed before, must not reach a force.
DIGITS = 3


def with_one_more(fit: ConfiguredFit, evidence: Evidence) -> float:
    """ln of the weight of a fit and of all that it may be with one more cause, over its own (nats):
    each counts by what it gains less its price.

    Gains are those that the score test promises; of those that promise more than their price the
    best few are fitted, and count by that, as a parabola is no measure of a large gain.
    """
    promised = [_promise(fit, effect, evidence) for effect in catalogue()]
    worth = [one.net for one in promised if one.net <= 0]
    likely = sorted((one for one in promised if one.net > 0), key=lambda one: -one.net)
    for one in likely[:MOST_FITTED]:
        only = {one.effect.name: (one.index,)}
        tried = try_effects(fit, [one.effect], evidence, only=only)
        worth += [fitted.net - CAUSE_NATS for fitted in tried]
    return round(float(logsumexp([0.0, *worth])), DIGITS)


@dataclass(frozen=True)
class _Promise:
    """What the best hypothesis of an effect promises beyond its price (nats), and its index."""

    effect: Effect
    net: float
    index: int


def _promise(fit: ConfiguredFit, effect: Effect, evidence: Evidence) -> _Promise:
    """The best of an effect's hypotheses; −inf where none can be foretold."""
    best = _Promise(effect, -math.inf, 0)
    for index, one in enumerate(effect.hypotheses(fit.model.experiment, evidence)):
        gain = promised_gain(fit, one)
        if gain is not None:
            net = gain - penalty(fit, one) - CAUSE_NATS
            best = max(best, _Promise(effect, net, index), key=lambda each: each.net)
    return best
