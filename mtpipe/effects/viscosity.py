"""Viscosity or temperature of the buffer other than configured (PHYSICS E10)."""

from __future__ import annotations

import math

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, factor, with_fluid
from mtpipe.experiment.description import Experiment


def _change(experiment: Experiment, ln_factor: float) -> Experiment:
    value = experiment.fluid.viscosity_mPa_s * math.exp(ln_factor)
    return with_fluid(experiment, viscosity_mPa_s=value)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [Hypothesis(experiment, (factor("viscosity over configured", _change),))]


EFFECT = Effect(
    "viscosity",
    _hypotheses,
    lambda experiment: f"the buffer's viscosity is {experiment.fluid.viscosity_mPa_s:.3g} mPa s",
    lambda experiment: [("viscosity_mPa_s", experiment.fluid.viscosity_mPa_s, "mPa s")],
)
