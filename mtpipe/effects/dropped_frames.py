"""Frames missing while the file counts on (PHYSICS E13)."""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changed import changed
from mtpipe.experiment.description import Experiment


def _change(experiment: Experiment, share: float) -> Experiment:
    return changed(experiment, clock=changed(experiment.clock, dropped_share=max(share, 0.0)))


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    share = plain("share of frames dropped", "", 0.05, (0.0, 0.6), 1e-3, _change)
    return [Hypothesis(experiment, (share,))]


def _cause(experiment: Experiment) -> str:
    return (
        f"{100 * experiment.clock.dropped_share:.1f} % of the frames are missing, and the file "
        "shows no gap there"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("share", experiment.clock.dropped_share, "")]


_REMEDY = "check the camera's frame counter and the time column of the file."
EFFECT = Effect("dropped_frames", _hypotheses, _cause, _strengths, shared=True, remedy=_REMEDY)
