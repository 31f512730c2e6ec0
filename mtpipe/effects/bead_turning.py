"""Recorded height that follows the bead's free turning about the field (PHYSICS E25).

A bead whose image is not round is recorded higher or lower as it turns. The turn is held by the
tether's pull alone, so that what it adds to z falls as 1/F and is slower than z itself.
"""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import with_bead
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Change

# Real beads have 40 to 390 nm per radian; the height of a bead's centre is at most its radius away.
STARTS_NM, LARGEST_NM = (-100.0, 100.0), 1000.0


def per_turn(experiment: Experiment, name: str, change: Change) -> list[Hypothesis]:
    """That something recorded follows the bead's turning, to either side; none of a bead that does
    not turn.

    Parameters
    ----------
    change : of the experiment by the nm per radian.
    """
    if not experiment.bead.turns:
        return []
    bounds = (-LARGEST_NM, LARGEST_NM)
    return [
        Hypothesis(experiment, (plain(name, "nm", start, bounds, 0.5, change),))
        for start in STARTS_NM
    ]


def _change(experiment: Experiment, nm_per_rad: float) -> Experiment:
    return with_bead(experiment, z_per_turn_nm=nm_per_rad)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    return per_turn(experiment, "z per turn", _change)


def _cause(experiment: Experiment) -> str:
    return (
        "the recorded height follows the bead's turning about the field, by "
        f"{abs(experiment.bead.z_per_turn_nm):.0f} nm per radian"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("nm_per_rad", experiment.bead.z_per_turn_nm, "nm")]


_REMEDY = "use a smoother bead, or take heights only from means over a long time."
EFFECT = Effect("bead_turning", _hypotheses, _cause, _strengths, remedy=_REMEDY)
