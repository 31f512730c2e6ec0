"""Camera axes turned against the field, or the field's axis mislabelled (PHYSICS E14)."""

from __future__ import annotations

import math

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import with_optics
from mtpipe.experiment.description import Experiment

STARTS_DEG = (-60.0, -25.0, 25.0, 60.0, 85.0)


def _change(experiment: Experiment, degrees: float) -> Experiment:
    return with_optics(experiment, angle_rad=math.radians(degrees))


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [
        Hypothesis(experiment, (plain("angle", "°", start, (-95.0, 95.0), 0.1, _change),))
        for start in STARTS_DEG
    ]


def _cause(experiment: Experiment) -> str:
    return (
        "the camera's axes are turned against the field's by "
        f"{abs(math.degrees(experiment.optics.angle_rad)):.1f}°"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("angle_deg", math.degrees(experiment.optics.angle_rad), "°")]


_REMEDY = (
    "measure it again; if the value found here is right, correct [field] direction, or the "
    "orientation of the camera, in the setup."
)
EFFECT = Effect(
    "field_rotation",
    _hypotheses,
    _cause,
    _strengths,
    shared=True,
    remedy=_REMEDY,
    unnamed=("mixing", ("x", "y")),
)
