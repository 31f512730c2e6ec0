"""Contour length other than configured (PHYSICS E17)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, factor
from mtpipe.experiment.changes import scaled_contour_length
from mtpipe.experiment.description import Experiment

STARTS = (0.0, -0.1, 0.1)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [
        Hypothesis(
            experiment,
            (factor("contour length over configured", scaled_contour_length, start=start),),
        )
        for start in STARTS
    ]


def _cause(experiment: Experiment) -> str:
    return f"the tether's contour is {experiment.chain.contour_length_nm:.0f} nm long"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("contour_length_nm", experiment.chain.contour_length_nm, "nm")]


_REMEDY = (
    "measure it again; if the value found here is right, correct [tether] contour_length_nm in "
    "the setup."
)
EFFECT = Effect("contour_length", _hypotheses, _cause, _strengths, remedy=_REMEDY)
