"""Pixel size in x and y wrong (PHYSICS E12)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, factor
from mtpipe.experiment.changes import scaled_x_and_y
from mtpipe.experiment.description import Experiment


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [Hypothesis(experiment, (factor("recorded over true x and y", scaled_x_and_y),))]


def _cause(experiment: Experiment) -> str:
    return f"x and y are recorded {experiment.optics.lateral_scale:.3f} times as large as they are"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("factor", experiment.optics.lateral_scale, "")]


EFFECT = Effect("lateral_scale", _hypotheses, _cause, _strengths, shared=True)
