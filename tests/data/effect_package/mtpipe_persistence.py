"""Persistence length other than configured, as at low salt (Baumann et al. 1997)."""

import math

from mtpipe.effects.effect import Effect, Hypothesis, factor
from mtpipe.experiment.changes import with_chain


def _change(experiment, ln_factor):
    length = experiment.chain.persistence_length_nm * math.exp(ln_factor)
    return with_chain(experiment, persistence_length_nm=length)


def _hypotheses(experiment, evidence):
    return [Hypothesis(experiment, (factor("persistence length over configured", _change),))]


def _cause(experiment):
    return f"the tether's persistence length is {experiment.chain.persistence_length_nm:.1f} nm"


def _strengths(experiment):
    return [("persistence_length_nm", experiment.chain.persistence_length_nm, "nm")]


EFFECT = Effect("persistence_length", _hypotheses, _cause, _strengths)
