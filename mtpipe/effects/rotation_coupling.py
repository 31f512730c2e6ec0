"""The bead's rotation about the field's axis couples to y (Daldrop et al. 2015; PHYSICS E2)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.changes import with_bead
from mtpipe.experiment.description import Experiment


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.bead.turns:
        return []
    return [Hypothesis(with_bead(experiment, turns=True), ())]


EFFECT = Effect(
    "rotation_coupling",
    _hypotheses,
    lambda experiment: "the bead's rotation couples to its motion across the field",
    lambda experiment: [],
)
