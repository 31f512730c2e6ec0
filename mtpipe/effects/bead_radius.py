"""Bead radius other than configured (PHYSICS E11)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, factor
from mtpipe.experiment.changes import scaled_radius
from mtpipe.experiment.description import Experiment


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [Hypothesis(experiment, (factor("bead radius over configured", scaled_radius),))]


def _cause(experiment: Experiment) -> str:
    return f"the bead's radius is {experiment.bead.radius_nm:.0f} nm"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("radius_nm", experiment.bead.radius_nm, "nm")]


_REMEDY = (
    "measure it again; if the value found here is right, correct [beads] radius_nm in the setup."
)
EFFECT = Effect("bead_radius", _hypotheses, _cause, _strengths, remedy=_REMEDY)
