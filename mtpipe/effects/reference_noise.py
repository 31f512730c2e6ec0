"""Motion of the reference bead itself, carried into the trace by subtraction (PHYSICS E8).

Where the subtraction leaves that out, as the reference was seen to move on its own, it leaves the
stage's drift in the trace instead.
"""

from __future__ import annotations

from functools import partial

from mtpipe.drift.largest_motion import LargestMotion
from mtpipe.effects import drift
from mtpipe.effects.effect import Effect, Evidence, Hypothesis, logarithm, plain
from mtpipe.experiment.changed import with_root
from mtpipe.experiment.changes import with_optics, with_stage
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Parameter
from mtpipe.experiment.step import axes_with_another

STARTS_S = (0.1, 2.0)
LARGEST_NM = 300.0
# A fit begins with this size, and tells slopes by this change of a variance, in nm² and as shares
# of the largest.
START_NM, STEP_NM2, LEAST_STEP, MOST_STEP = 2.0, 0.08, 1e-7, 0.02


def _along(axis: int, largest: LargestMotion | None, relaxation_s: float) -> Parameter:
    """The variance along one axis, over the largest that the reference's own trace allows."""
    name = f"reference motion along {'xyz'[axis]}, share of the largest"
    most_nm2 = _largest_nm2(axis, largest, relaxation_s)
    start = min(START_NM**2 / most_nm2, 0.5)
    step = min(max(STEP_NM2 / most_nm2, LEAST_STEP), MOST_STEP)
    return plain(name, "", start, (0.0, 1.0), step, partial(_moved, axis, largest))


def _moved(
    axis: int, largest: LargestMotion | None, experiment: Experiment, share: float
) -> Experiment:
    square = share * _largest_nm2(axis, largest, experiment.stage.reference_s)
    return with_stage(
        experiment, reference_nm=with_root(experiment.stage.reference_nm, axis, square)
    )


def _largest_nm2(axis: int, largest: LargestMotion | None, relaxation_s: float) -> float:
    anyhow = LARGEST_NM**2
    return anyhow if largest is None else min(largest.at(axis, relaxation_s), anyhow)


def _begun(experiment: Experiment, value: float) -> Experiment:
    zero = experiment.optics.z_zero_nm - value * experiment.stage.reference_nm[2]
    return with_optics(experiment, z_zero_nm=zero)


def _relaxing(experiment: Experiment, value: float) -> Experiment:
    return with_stage(experiment, reference_s=value)


# Positions are counted from where the reference was at the start, in units of its motion.
AT_THE_START = Parameter(
    "reference at the start, z relative to its motion", "", 0.0, -6.0, 6.0, 0.01, (0.0, 1.0), _begun
)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.references == 0 or evidence.reference_moves is False:
        return []
    # as of drift: the stage's motion along an axis comes with the share of it in another
    mixed = axes_with_another(experiment.steps)
    axes = [axis for axis in range(3) if axis not in mixed]
    # what of the stage could not be subtracted is in the trace too
    without = [drift.left(experiment)] if evidence.reference_loose else []
    walks = without[0].parameters if without else ()
    largest = evidence.reference_largest
    return without + [
        Hypothesis(
            experiment,
            (
                # first, as the largest sizes depend on it
                logarithm("reference relaxation time", "s", start, (0.005, 100.0), _relaxing),
                *(_along(axis, largest, start) for axis in axes),
                *([AT_THE_START] if 2 in axes else []),
                *walks,
            ),
            given=1,
        )
        for start in STARTS_S
        if axes
    ]


def _left_in_place(experiment: Experiment) -> bool:
    """Whether it is drift that is in the trace, and not the reference's motion."""
    stage = experiment.stage
    return any(stage.unsubtracted_nm_per_root_s) and not any(stage.reference_nm)


def _cause(experiment: Experiment) -> str:
    x, y, z = experiment.stage.reference_nm
    if _left_in_place(experiment):
        x, y, z = experiment.stage.unsubtracted_nm_per_root_s
        return (
            "the reference bead moves on its own, so that little could be subtracted, and drift of "
            f"{x:.2g}, {y:.2g} and {z:.2g} nm per root second in x, y and z is left in the trace"
        )
    return (
        f"the reference bead moves on its own, {x:.1f}, {y:.1f} and {z:.1f} nm in x, y and z "
        f"within {experiment.stage.reference_s:.2g} s, and subtraction carries that into the trace"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    if _left_in_place(experiment):
        return drift.walks(experiment)
    return [
        (f"motion_{a}_nm", v, "nm")
        for a, v in zip("xyz", experiment.stage.reference_nm, strict=True)
    ] + [("relaxation_s", experiment.stage.reference_s, "s")]


_REMEDY = "use another reference bead, or several: this one moves by itself."
EFFECT = Effect(
    "reference_noise",
    _hypotheses,
    _cause,
    _strengths,
    remedy=_REMEDY,
    unnamed=("power_law", ("x", "y", "z")),
)
