"""z scale wrong: refractive index, look-up table (PHYSICS E12)."""

from __future__ import annotations

import math

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, factor
from mtpipe.experiment.changes import with_optics
from mtpipe.experiment.description import Experiment

STARTS = (0.0, -0.1, 0.1)


def _change(experiment: Experiment, ln_factor: float) -> Experiment:
    return with_optics(experiment, axial_scale=experiment.optics.axial_scale * math.exp(ln_factor))


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [
        Hypothesis(experiment, (factor("recorded over true z", _change, start=start),))
        for start in STARTS
    ]


def _cause(experiment: Experiment) -> str:
    return f"z is recorded {experiment.optics.axial_scale:.3f} times as large as it is"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("factor", experiment.optics.axial_scale, "")]


_REMEDY = (
    "measure it again; if the value found here is right, correct the scale of z (focus scan, "
    "refractive index) in the setup."
)
EFFECT = Effect(
    "axial_scale", _hypotheses, _cause, _strengths, remedy=_REMEDY, unnamed=("gain", ("z",))
)
