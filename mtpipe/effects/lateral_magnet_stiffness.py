"""Extra lateral stiffness from the magnets, in x and y, in proportion to the force (E15)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import Experiment

PER_NM = 1e-6  # per mm
STARTS_PER_MM = (20.0, 200.0)


def _change(experiment: Experiment, per_mm: float) -> Experiment:
    return with_magnets(experiment, sideways_per_nm=PER_NM * per_mm)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [
        Hypothesis(
            experiment,
            (plain("stiffness over force", "1/mm", start, (0.0, 5e3), 0.5, _change),),
        )
        for start in STARTS_PER_MM
    ]


def _cause(experiment: Experiment) -> str:
    return (
        "the magnets hold the bead sideways, with a stiffness of the force divided by "
        f"{1 / max(experiment.magnets.sideways_per_nm, 1e-12) / 1e3:.3g} µm"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("stiffness_over_force_per_mm", experiment.magnets.sideways_per_nm / PER_NM, "1/mm")]


EFFECT = Effect("lateral_magnet_stiffness", _hypotheses, _cause, _strengths)
