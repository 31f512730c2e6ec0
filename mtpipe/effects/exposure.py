"""Shutter time other than configured (PHYSICS E6)."""

from __future__ import annotations

import math

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.changes import scaled_exposure
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import EXPOSURE, SHORTEST_EXPOSURE, Parameter

STARTS = (-0.3, 0.3)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    camera = experiment.camera
    highest = math.log(camera.frame_s / camera.exposure_s)
    lowest = math.log(SHORTEST_EXPOSURE * camera.frame_s / camera.exposure_s)

    return [
        Hypothesis(
            experiment,
            (
                Parameter(
                    EXPOSURE, "", start, lowest, max(highest, 0.0), 1e-3, None,
                    scaled_exposure,
                ),
            ),
        )
        for start in STARTS
        if lowest < start <= highest
    ]  # fmt: skip


def _cause(experiment: Experiment) -> str:
    return (
        f"the camera exposes for {1e3 * experiment.camera.exposure_s:.3g} ms of each "
        f"{1e3 * experiment.camera.frame_s:.3g} ms"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("exposure_s", experiment.camera.exposure_s, "s")]


_REMEDY = (
    "measure it again; if the value found here is right, correct [camera] exposure_s in the setup."
)
EFFECT = Effect("exposure", _hypotheses, _cause, _strengths, shared=True, remedy=_REMEDY)
