"""White localisation noise (PHYSICS E5)."""

from __future__ import annotations

from dataclasses import replace

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import noise_parameters


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if any(experiment.tracker.noise_nm):
        return []
    tracker = replace(experiment.tracker, noise_nm=(3.0, 3.0, 4.5))
    return [Hypothesis(replace(experiment, tracker=tracker), noise_parameters((3.0, 3.0, 4.5)))]


def _cause(experiment: Experiment) -> str:
    x, y, z = experiment.tracker.noise_nm
    return f"the tracker adds white noise of {x:.1f}, {y:.1f} and {z:.1f} nm in x, y and z"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [
        (f"noise_{a}_nm", v, "nm") for a, v in zip("xyz", experiment.tracker.noise_nm, strict=True)
    ]


EFFECT = Effect(
    "tracking_noise", _hypotheses, _cause, _strengths, unnamed=("white", ("x", "y", "z"))
)
