"""The bead's rotation about the field's axis couples to y (Daldrop et al. 2015; PHYSICS E2)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.changes import with_bead
from mtpipe.experiment.description import Experiment


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.bead.turns:
        return []
    return [Hypothesis(with_bead(experiment, turns=True), ())]


def _cause(experiment: Experiment) -> str:
    return "the bead's rotation couples to its motion across the field"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return []


EFFECT = Effect("rotation_coupling", _hypotheses, _cause, _strengths)
