"""What causes cost before any data, and what all of them together are worth beside a fit."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import logsumexp

from mtpipe.effects.catalogue import OWN, catalogue
from mtpipe.effects.effect import Effect, Evidence
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import penalty
from mtpipe.joint_fit.score_test import promised_gain

# Prior odds of a cause outside the catalogue against one inside it.
UNKNOWN = 0.05
# Prior cost of a cause, in nats: each effect of the catalogue is taken for equally likely.
CAUSE_NATS = math.log(len(OWN))
# Nats that a term costs: 10 more than a name, as a form with a free law in the force fits more
# recordings than physics does.
TERM_NATS = CAUSE_NATS + 10.0


def with_one_more(fit: ConfiguredFit, evidence: Evidence) -> float:
    """ln of the weight of a fit and of all that it may be with one more cause, over its own (nats):
    each counts by what it promises less its price.
    """
    worth = [_promise(fit, effect, evidence) - CAUSE_NATS for effect in catalogue()]
    return float(logsumexp([0.0, *worth]))


def _promise(fit: ConfiguredFit, effect: Effect, evidence: Evidence) -> float:
    """What an effect promises to gain, less what its numbers cost; −inf where that is not told."""
    found = [-np.inf]
    for one in effect.hypotheses(fit.model.experiment, evidence):
        gain = promised_gain(fit, one)
        if gain is not None:
            found.append(gain - penalty(fit, one))
    return max(found)
