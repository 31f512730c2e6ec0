"""Force changing within a plateau (PHYSICS E23)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain, with_magnets
from mtpipe.experiment.description import Experiment

STARTS = (-0.15, 0.15)


def _change(experiment: Experiment, relative: float) -> Experiment:
    return with_magnets(experiment, relative_change=relative)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [
        Hypothesis(
            with_magnets(experiment, course=course),
            (plain("relative change of the force", "", start, (-1.2, 1.2), 2e-3, _change),),
        )
        for course in ("ramp", "settling")
        for start in STARTS
    ]


EFFECT = Effect(
    "force_drift",
    _hypotheses,
    lambda experiment: (
        f"the force changes by {experiment.magnets.relative_change:+.1%} during each plateau "
        f"({experiment.magnets.course})"
    ),
    lambda experiment: [("relative_change", experiment.magnets.relative_change, "")],
)
