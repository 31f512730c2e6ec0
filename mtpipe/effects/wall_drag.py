"""Friction raised by the surface, by the bead's height (Faxén 1922; Brenner 1961; PHYSICS E1)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.changes import with_fluid
from mtpipe.experiment.description import Experiment


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.fluid.wall:
        return []
    return [Hypothesis(with_fluid(experiment, wall=True), ())]


def _cause(experiment: Experiment) -> str:
    return "the surface raises the bead's friction, the more the lower it hangs"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return []


EFFECT = Effect("wall_drag", _hypotheses, _cause, _strengths)
