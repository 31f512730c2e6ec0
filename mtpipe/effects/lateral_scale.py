"""Pixel size in x and y wrong (PHYSICS E12)."""

from __future__ import annotations

import math

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, factor
from mtpipe.experiment.changes import with_optics
from mtpipe.experiment.description import Experiment


def _change(experiment: Experiment, ln_factor: float) -> Experiment:
    return with_optics(
        experiment, lateral_scale=experiment.optics.lateral_scale * math.exp(ln_factor)
    )


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [Hypothesis(experiment, (factor("recorded over true x and y", _change),))]


EFFECT = Effect(
    "lateral_scale",
    _hypotheses,
    lambda experiment: (
        f"x and y are recorded {experiment.optics.lateral_scale:.3f} times as large as they are"
    ),
    lambda experiment: [("factor", experiment.optics.lateral_scale, "")],
    shared=True,
)
