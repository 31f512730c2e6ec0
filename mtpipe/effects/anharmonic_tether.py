"""A bead at low force in the whole of the tether's potential, down to the surface (PHYSICS E20)."""

from __future__ import annotations

from dataclasses import replace

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.state import LOW_TILT, has_whole_motion
from mtpipe.physics.tether import mean_extension_nm


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    lowest_pN = min(evidence.force_pN)
    height_nm = float(mean_extension_nm(experiment.chain, lowest_pN))
    tilt = experiment.fluid.thermal_energy_pN_nm / (lowest_pN * height_nm)
    if experiment.anharmonic or not has_whole_motion(experiment) or tilt < LOW_TILT[0]:
        return []
    return [Hypothesis(replace(experiment, anharmonic=True), ())]


EFFECT = Effect(
    "anharmonic_tether",
    _hypotheses,
    lambda experiment: (
        "at low force the bead wanders through the whole of the tether's potential, down to the "
        "surface, and not only close to its mean"
    ),
    lambda experiment: [],
)
