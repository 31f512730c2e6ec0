"""Bead that rocks against the magnets' torque, its tether attached beside its lowest point
(PHYSICS E26).

The tilt is coupled to the motion along the field and, by the attachment's offset, to the height.
The torque goes with the field: as the force where the bead is far from saturated, less where it is
near.
"""

from __future__ import annotations

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, logarithm, plain
from mtpipe.effects.magnetic_alignment import held_with, torque_stiffness
from mtpipe.effects.off_center_attachment import attached_beside, offset
from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import Experiment
from mtpipe.ground.written_numbers import rounded

# Attachment's distance from the bead's axis, over the radius: starts of the fit, and its bound. At
# 1 the bead would hang by its side.
STARTS, LARGEST = (-0.5, -0.05, 0.05, 0.5), 0.97
# Torque stiffness against tilting at 1 pN, pN nm/rad: start and bounds of the fit. Real beads have
# some 2e3; above 1e6 no bead is seen to rock.
START_PN_NM, BOUNDS_PN_NM = 1e3, (10.0, 1e6)
# Exponent of the torque stiffness as a power of the force, start and bounds: 1 for a bead far from
# saturation, 0 where the field is much the same at all forces.
START_POWER, BOUNDS_POWER = 0.5, (0.0, 1.0)


def _beside(experiment: Experiment, share: float) -> Experiment:
    return attached_beside(experiment, share * experiment.bead.radius_nm)


def _power(experiment: Experiment, value: float) -> Experiment:
    return with_magnets(experiment, alignment_power=value)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.rocks:
        return []
    torque = (
        logarithm("torque stiffness", "pN nm/rad", START_PN_NM, BOUNDS_PN_NM, held_with),
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
    ((_, beside_nm, _),), ((_, torque, _),) = offset(experiment), torque_stiffness(experiment)
    return (
        f"the bead rocks: its tether is attached {abs(beside_nm):.0f} nm beside its lowest "
        f"point, and the field holds it with {rounded(torque, 2)} pN nm/rad at 1 pN"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    power = ("torque_power", experiment.magnets.alignment_power, "")
    return [*offset(experiment), *torque_stiffness(experiment), power]


_REMEDY = (
    "take forces from x and y, or raise the field: a stronger magnet holds the bead's axis more "
    "stiffly."
)
EFFECT = Effect("bead_rocking", _hypotheses, _cause, _strengths, remedy=_REMEDY)
