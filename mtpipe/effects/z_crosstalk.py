"""Recorded height that contains a share of x and y (PHYSICS E24).

A look-up table's image that leans, or is not round, moves with the bead: z follows the camera's
x and y at once, at every frequency alike.
"""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import with_optics
from mtpipe.experiment.description import Experiment

# Shares of real recordings are 0.02 to 0.35; a height that follows by more is no height.
LARGEST = 0.8


def _from_x(experiment: Experiment, share: float) -> Experiment:
    return with_optics(experiment, z_from_x=share)


def _from_y(experiment: Experiment, share: float) -> Experiment:
    return with_optics(experiment, z_from_y=share)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    shares = (
        plain("share of x in z", "", 0.0, (-LARGEST, LARGEST), 1e-3, _from_x),
        plain("share of y in z", "", 0.0, (-LARGEST, LARGEST), 1e-3, _from_y),
    )
    return [Hypothesis(experiment, shares)]


def _cause(experiment: Experiment) -> str:
    optics = experiment.optics
    return (
        f"the recorded height follows x and y: it contains {optics.z_from_x:+.3f} of x and "
        f"{optics.z_from_y:+.3f} of y"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [
        ("slope_x", experiment.optics.z_from_x, ""),
        ("slope_y", experiment.optics.z_from_y, ""),
    ]


EFFECT = Effect("z_crosstalk", _hypotheses, _cause, _strengths)
