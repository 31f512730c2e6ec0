"""A bead at low force in the whole of the tether's potential, down to the surface (PHYSICS E20)."""

from __future__ import annotations

from dataclasses import replace

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.state import has_whole_motion, low_share


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.anharmonic or not has_whole_motion(experiment):
        return []
    if low_share(experiment, min(evidence.force_pN)) == 0:
        return []
    return [Hypothesis(replace(experiment, anharmonic=True), ())]


def _cause(experiment: Experiment) -> str:
    return (
        "at low force the bead wanders through the whole of the tether's potential, down to the "
        "surface, and not only close to its mean"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return []


EFFECT = Effect("anharmonic_tether", _hypotheses, _cause, _strengths)
