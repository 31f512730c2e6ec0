"""Contour length other than configured (PHYSICS E17)."""

from __future__ import annotations

import math

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, factor, with_chain
from mtpipe.experiment.description import Experiment

STARTS = (-0.1, 0.1)


def _change(experiment: Experiment, ln_factor: float) -> Experiment:
    length = experiment.chain.contour_length_nm * math.exp(ln_factor)
    return with_chain(experiment, contour_length_nm=length)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [
        Hypothesis(experiment, (factor("contour length over configured", _change, start=start),))
        for start in STARTS
    ]


EFFECT = Effect(
    "contour_length",
    _hypotheses,
    lambda experiment: f"the tether's contour is {experiment.chain.contour_length_nm:.0f} nm long",
    lambda experiment: [("contour_length_nm", experiment.chain.contour_length_nm, "nm")],
)
