"""Friction that depends on frequency, by the fluid's own motion (PHYSICS E22).

Far from any surface it is all of the known effect. A surface nearby takes the moving fluid's
momentum away and screens memory, how much is known for few geometries; so the share is fitted.
"""

from __future__ import annotations

import math

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, plain
from mtpipe.experiment.changes import with_fluid
from mtpipe.experiment.description import Experiment
from mtpipe.physics.memory import memory_time_s

# Least relative change of the friction at half the frame rate for which the effect is tried.
SEEN = 0.05
START, LARGEST = 0.5, 2.0


def _change(experiment: Experiment, value: float) -> Experiment:
    return with_fluid(experiment, memory=value)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    bead, fluid = experiment.bead, experiment.fluid
    # √(f/f_ν) with f_ν = η/(πR²ρ)
    fastest = 0.5 / experiment.camera.frame_s
    change = (math.pi * fastest * memory_time_s(bead.radius_nm, fluid.viscosity_mPa_s)) ** 0.5
    if fluid.memory > 0 or change < SEEN:
        return []
    share = plain("share of the bulk's", "", START, (0.0, LARGEST), 0.02, _change)
    return [Hypothesis(experiment, (share,))]


def _cause(experiment: Experiment) -> str:
    return (
        "the fluid that the bead has set in motion drags it along (hydrodynamic memory, "
        f"{experiment.fluid.memory:.2g} times as strong as far from any surface)"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    return [("share_of_bulk", experiment.fluid.memory, "")]


EFFECT = Effect("hydrodynamic_memory", _hypotheses, _cause, _strengths)
