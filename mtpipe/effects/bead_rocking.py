"""Bead that rocks against the magnets' torque, its tether attached beside its lowest point
(PHYSICS E26).

The tilt is coupled to the motion along the field and, by the attachment's offset, to the height.
The torque goes with the field: as the force where the bead is far from saturated, less where it is
near.
"""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, logarithm, plain
from mtpipe.experiment.changes import with_bead, with_magnets
from mtpipe.experiment.description import Experiment

# Over the radius. Farther out a bead would hang by its side.
STARTS, LARGEST = (-0.5, 0.5), 0.97
# Against tilting, at 1 pN. Real beads have some 2e3; above 1e6 no bead is seen to rock.
START_PN_NM, BOUNDS_PN_NM = 1e3, (10.0, 1e6)
# The torque's power of the force, from a saturated bead to one far from it.
START_POWER, BOUNDS_POWER = 0.5, (0.0, 1.0)


def _beside(experiment: Experiment, share: float) -> Experiment:
    return with_bead(experiment, offset_nm=share * experiment.bead.radius_nm)


def _stiffness(experiment: Experiment, value: float) -> Experiment:
    return with_magnets(experiment, alignment_pN_nm=value)


def _power(experiment: Experiment, value: float) -> Experiment:
    return with_magnets(experiment, alignment_power=value)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.rocks:
        return []
    torque = (
        logarithm("torque stiffness", "pN nm/rad", START_PN_NM, BOUNDS_PN_NM, _stiffness),
        plain("power of the torque, a number", "", START_POWER, BOUNDS_POWER, 1e-2, _power),
    )
    return [
        Hypothesis(
            experiment,
            (
                plain("offset, share of the radius", "", start, (-LARGEST, LARGEST), 1e-3, _beside),
                *torque,
            ),
        )
        for start in STARTS
    ]


def _cause(experiment: Experiment) -> str:
    bead, magnets = experiment.bead, experiment.magnets
    return (
        f"the bead rocks: its tether is attached {abs(bead.offset_nm):.0f} nm beside its lowest "
        f"point, and the field holds it with {magnets.alignment_pN_nm or 0.0:.2g} pN nm/rad at 1 pN"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    magnets = experiment.magnets
    return [
        ("offset_nm", experiment.bead.offset_nm, "nm"),
        ("torque_stiffness_pN_nm", magnets.alignment_pN_nm or 0.0, "pN nm/rad"),
        ("torque_power", magnets.alignment_power, ""),
    ]


_REMEDY = (
    "take forces from x and y, or raise the field: a stronger magnet holds the bead's axis more "
    "stiffly."
)
EFFECT = Effect("bead_rocking", _hypotheses, _cause, _strengths, remedy=_REMEDY)
