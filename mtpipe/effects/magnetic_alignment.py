"""Finite torque stiffness that holds the bead's axis (Klaue & Seidel 2009; PHYSICS E3)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, logarithm
from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import Experiment
from mtpipe.ground.written_numbers import rounded

STARTS_PN_NM = (1e3, 3e4)


def held_with(experiment: Experiment, value: float) -> Experiment:
    """The experiment with this torque stiffness, pN nm, at 1 pN."""
    return with_magnets(experiment, alignment_pN_nm=value)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return [
        Hypothesis(
            experiment,
            (
                logarithm(
                    "torque stiffness", "pN nm/rad", start, (10.0, 1e8),
                    held_with,
                ),
            ),
        )
        for start in STARTS_PN_NM
    ]  # fmt: skip


def _cause(experiment: Experiment) -> str:
    return (
        "the field holds the bead's axis with a torque stiffness of only "
        f"{rounded(experiment.magnets.alignment_pN_nm or 0.0, 2)} pN nm/rad"
    )


def torque_stiffness(experiment: Experiment) -> list[tuple[str, float, str]]:
    """The torque stiffness, as it is reported."""
    return [("torque_stiffness_pN_nm", experiment.magnets.alignment_pN_nm or 0.0, "pN nm/rad")]


EFFECT = Effect("magnetic_alignment", _hypotheses, _cause, torque_stiffness)
