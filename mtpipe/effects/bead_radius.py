"""Bead radius other than configured (PHYSICS E11)."""

from __future__ import annotations

import math

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, factor, with_bead
from mtpipe.experiment.description import Experiment


def _change(experiment: Experiment, ln_factor: float) -> Experiment:
    return with_bead(experiment, radius_nm=experiment.bead.radius_nm * math.exp(ln_factor))


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [Hypothesis(experiment, (factor("bead radius over configured", _change),))]


EFFECT = Effect(
    "bead_radius",
    _hypotheses,
    lambda experiment: f"the bead's radius is {experiment.bead.radius_nm:.0f} nm",
    lambda experiment: [("radius_nm", experiment.bead.radius_nm, "nm")],
)
