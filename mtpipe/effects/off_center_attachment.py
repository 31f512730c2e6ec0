"""Tether attached beside the bead's lowest point (Shon, Rah & Yoon 2019; PHYSICS E4)."""

from __future__ import annotations

import math

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import with_bead
from mtpipe.experiment.description import Experiment

LARGEST = 0.97


def attached_beside(experiment: Experiment, offset_nm: float) -> Experiment:
    """The experiment with the tether attached beside the bead's lowest point."""
    return with_bead(experiment, offset_nm=offset_nm)


def _change(experiment: Experiment, share: float) -> Experiment:
    # fitted is what the bead's lever loses, over R: data follow it in proportion
    offset_nm = math.sqrt(max(1 - (1 - share) ** 2, 0.0)) * experiment.bead.radius_nm
    return attached_beside(experiment, offset_nm)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    radius = experiment.bead.radius_nm
    bounds = (0.0, 1 - math.sqrt(1 - LARGEST**2))
    lost = plain(f"1 - lever / {radius:g} nm", "", 0.05, bounds, 1e-3, _change)
    return [Hypothesis(experiment, (lost,))]


def _cause(experiment: Experiment) -> str:
    return (
        f"the tether is attached {experiment.bead.offset_nm:.0f} nm off the bead's axis, so that "
        f"the recorded height is {experiment.bead.radius_nm - experiment.bead.lever_nm:.0f} nm too "
        "small"
    )


def offset(experiment: Experiment) -> list[tuple[str, float, str]]:
    """The offset, as it is reported."""
    return [("offset_nm", experiment.bead.offset_nm, "nm")]


_REMEDY = (
    "expect it of beads with many binding sites; list it under [model] effects to "
    "have it in every fit."
)
EFFECT = Effect("off_center_attachment", _hypotheses, _cause, offset, remedy=_REMEDY)
