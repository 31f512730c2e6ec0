"""Shutter time other than configured (PHYSICS E6)."""

from __future__ import annotations

import math
from dataclasses import replace

from mtpipe.configured.model import Parameter
from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.description import Experiment
from mtpipe.physics.camera import Camera

SHORTEST = 0.02
STARTS = (-0.3, 0.3)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    camera = experiment.camera
    highest = math.log(camera.frame_s / camera.exposure_s)
    lowest = math.log(SHORTEST * camera.frame_s / camera.exposure_s)

    def change(other: Experiment, ln_factor: float) -> Experiment:
        exposure = min(camera.exposure_s * math.exp(ln_factor), camera.frame_s)
        return replace(other, camera=Camera(camera.frame_s, exposure))

    return [
        Hypothesis(
            experiment,
            (
                Parameter(
                    "exposure over configured", "", start, lowest, max(highest, 0.0), 1e-3, None,
                    change, kind="ln",
                ),
            ),
        )
        for start in STARTS
        if lowest < start <= highest
    ]  # fmt: skip


EFFECT = Effect(
    "exposure",
    _hypotheses,
    lambda experiment: (
        f"the camera exposes for {1e3 * experiment.camera.exposure_s:.3g} ms of each "
        f"{1e3 * experiment.camera.frame_s:.3g} ms"
    ),
    lambda experiment: [("exposure_s", experiment.camera.exposure_s, "s")],
)
