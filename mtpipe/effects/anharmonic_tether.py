"""A bead at low force in the whole of the tether's potential, down to the surface (PHYSICS E20)."""

from __future__ import annotations

from dataclasses import replace

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.state import has_whole_motion
from mtpipe.physics.tether import mean_extension_nm

# Mean square tilt of the tether, kT/FL, from which on the effect is tried. The slow power of z by
# expansion is too small by some ten times that.
SEEN_TILT = 0.025


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    lowest_pN = min(evidence.force_pN)
    height_nm = float(mean_extension_nm(experiment.chain, lowest_pN))
    tilt = experiment.fluid.thermal_energy_pN_nm / (lowest_pN * height_nm)
    whole = replace(experiment, anharmonic=True)
    if experiment.anharmonic or not has_whole_motion(whole) or tilt < SEEN_TILT:
        return []
    return [Hypothesis(whole, ())]


EFFECT = Effect(
    "anharmonic_tether",
    _hypotheses,
    lambda experiment: (
        "at low force the bead wanders through the whole of the tether's potential, down to the "
        "surface, and not only close to its mean"
    ),
    lambda experiment: [],
)
