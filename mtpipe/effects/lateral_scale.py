"""Pixel size in x and y wrong, in both or in one of them (PHYSICS E12)."""

from __future__ import annotations

import math

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, factor
from mtpipe.experiment.changes import scaled_x_and_y, with_optics
from mtpipe.experiment.description import Experiment


def _x(experiment: Experiment, ln_factor: float) -> Experiment:
    _, y = experiment.optics.axis_scales or (1.0, 1.0)
    return with_optics(experiment, axis_scales=(math.exp(ln_factor), y))


def _y(experiment: Experiment, ln_factor: float) -> Experiment:
    x, _ = experiment.optics.axis_scales or (1.0, 1.0)
    return with_optics(experiment, axis_scales=(x, math.exp(ln_factor)))


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    both = factor("recorded over true x and y", scaled_x_and_y)
    x, y = factor("recorded over true x", _x), factor("recorded over true y", _y)
    apart = with_optics(experiment, axis_scales=(1.0, 1.0))
    # of one axis it may be the image of one bead; three forms to choose from
    return [
        Hypothesis(experiment, (both,)),
        Hypothesis(apart, (x,), chosen_from=3, own=True),
        Hypothesis(apart, (y,), chosen_from=3, own=True),
        Hypothesis(apart, (x, y), chosen_from=3, own=True),
    ]


def _cause(experiment: Experiment) -> str:
    optics = experiment.optics
    if optics.axis_scales is None:
        return f"x and y are recorded {optics.lateral_scale:.3f} times as large as they are"
    x, y = optics.axis_scales
    if x == 1 or y == 1:
        axis, scale = ("x", x) if y == 1 else ("y", y)
        return f"{axis} is recorded {scale:.3f} times as large as it is"
    return f"x is recorded {x:.3f} and y {y:.3f} times as large as they are"


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    optics = experiment.optics
    if optics.axis_scales is None:
        return [("factor", optics.lateral_scale, "")]
    x, y = optics.axis_scales
    return [("factor_x", x, ""), ("factor_y", y, "")]


_REMEDY = (
    "measure it again; if the value found here is right, correct [camera] pixel_size_nm (the "
    "scale of x and y) in the setup."
)
EFFECT = Effect(
    "lateral_scale",
    _hypotheses,
    _cause,
    _strengths,
    shared=True,
    remedy=_REMEDY,
    unnamed=("gain", ("x", "y")),
)
