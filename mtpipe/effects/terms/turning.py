"""Recorded position across the field that follows the bead's free turning about it.

An image that is not round moves as the bead turns: up or down (the effect `bead_turning`, PHYSICS
E25), and as well sideways.
"""

from __future__ import annotations

from mtpipe.effects.bead_turning import per_turn
from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.changes import with_bead
from mtpipe.experiment.description import Experiment


def aside() -> Effect:
    """The term. Which of x and y lies across the field is for the fit to say."""
    return Effect("turning_aside", _hypotheses, _words, _sizes, form="mixing", axes=("x", "y"))


def _change(experiment: Experiment, nm_per_rad: float) -> Experiment:
    return with_bead(experiment, aside_per_turn_nm=nm_per_rad)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    there = experiment.bead.aside_per_turn_nm != 0
    return [] if there else per_turn(experiment, "aside per turn", _change)


def _words(experiment: Experiment) -> str:
    return (
        "x and y contain the bead's turning about the field: across it the recorded position moves "
        f"by {abs(experiment.bead.aside_per_turn_nm):.0f} nm per radian"
    )


def _sizes(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("nm_per_rad", experiment.bead.aside_per_turn_nm, "nm")]
