"""Viscosity or temperature of the buffer other than configured (PHYSICS E10)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, factor
from mtpipe.experiment.changes import scaled_viscosity
from mtpipe.experiment.description import Experiment


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [Hypothesis(experiment, (factor("viscosity over configured", scaled_viscosity),))]


def _cause(experiment: Experiment) -> str:
    return f"the buffer's viscosity is {experiment.fluid.viscosity_mPa_s:.3g} mPa s"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("viscosity_mPa_s", experiment.fluid.viscosity_mPa_s, "mPa s")]


_REMEDY = (
    "measure it again; if the value found here is right, correct [buffer] viscosity_mPa_s or "
    "temperature_K in the setup."
)
EFFECT = Effect("viscosity", _hypotheses, _cause, _strengths, shared=True, remedy=_REMEDY)
