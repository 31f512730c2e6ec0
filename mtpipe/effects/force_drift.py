"""Force changing within a plateau (PHYSICS E23).

Spectra and mean heights, which are what is fitted, do not tell in which direction.
"""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import Experiment

START, LARGEST = 0.15, 1.0


def _change(experiment: Experiment, relative: float) -> Experiment:
    return with_magnets(experiment, relative_change=relative)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [
        Hypothesis(
            with_magnets(experiment, course=course),
            (plain("relative change of the force", "", START, (0.0, LARGEST), 2e-3, _change),),
        )
        for course in ("ramp", "settling")
    ]


EFFECT = Effect(
    "force_drift",
    _hypotheses,
    lambda experiment: (
        f"the force changes by {experiment.magnets.relative_change:.1%} during each plateau "
        f"({experiment.magnets.course}; spectra do not tell whether it rises or falls)"
    ),
    lambda experiment: [("relative_change", experiment.magnets.relative_change, "")],
)
