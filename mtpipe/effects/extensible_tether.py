"""Enthalpic stretching at high force (Wang et al. 1997; Odijk 1995; PHYSICS E16)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import with_chain
from mtpipe.experiment.description import Experiment
from mtpipe.physics.tether import STRETCHING

START_PN = 1000.0
# No double strand is known to be softer than 350 pN (RNA: Lipfert et al. 2014); what stretches
# more than one of 200 pN is something else, as a bead that rocks.
BOUNDS_PER_NN = (0.02, 5.0)


def _change(experiment: Experiment, per_nN: float) -> Experiment:
    formula = STRETCHING.get(experiment.chain.formula, experiment.chain.formula)
    return with_chain(experiment, formula=formula, stretch_modulus_pN=1000.0 / per_nN)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.chain.formula not in STRETCHING:
        return []
    start = 1000.0 / START_PN
    softness = plain("1 / stretch modulus", "1/nN", start, BOUNDS_PER_NN, 0.01, _change)
    return [Hypothesis(experiment, (softness,))]


def _cause(experiment: Experiment) -> str:
    return (
        "the tether itself stretches, with a modulus of "
        f"{experiment.chain.stretch_modulus_pN or 0.0:.0f} pN"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("stretch_modulus_pN", experiment.chain.stretch_modulus_pN or 0.0, "pN")]


EFFECT = Effect("extensible_tether", _hypotheses, _cause, _strengths)
