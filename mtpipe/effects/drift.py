"""Slow motion of the bead's position that reference subtraction left (PHYSICS E7)."""

from __future__ import annotations

from functools import partial

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, variance
from mtpipe.experiment.changed import with_root
from mtpipe.experiment.changes import with_stage
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Parameter
from mtpipe.experiment.step import axes_with_another

LARGEST_NM_PER_ROOT_S = 300.0


def along(axis: int, name: str) -> Parameter:
    """The random walk of one axis, as its variance per second."""
    change = partial(_change, axis)
    return variance(f"walk along {name}", "nm/√s", 1.0, LARGEST_NM_PER_ROOT_S, change)


def _change(axis: int, experiment: Experiment, per_s: float) -> Experiment:
    walk = with_root(experiment.stage.unsubtracted_nm_per_root_s, axis, per_s)
    return with_stage(experiment, unsubtracted_nm_per_root_s=walk)


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if evidence.reference_moves or evidence.reference_loose:
        return []
    return [left(experiment)]


def left(experiment: Experiment) -> Hypothesis:
    """Drift that was not subtracted, a random walk along each axis.

    Not along an axis in which a share of another is recorded: the stage's motion along the other
    comes with it, and the references need not lean by as much.
    """
    mixed = axes_with_another(experiment.steps)
    walks = [along(i, name) for i, name in enumerate("xyz") if i not in mixed]
    return Hypothesis(experiment, tuple(walks))


def _cause(experiment: Experiment) -> str:
    x, y, z = experiment.stage.unsubtracted_nm_per_root_s
    return (
        f"the bead's position drifts by {x:.2g}, {y:.2g} and {z:.2g} nm per root second in x, y "
        "and z relative to the reference"
    )


def walks(experiment: Experiment) -> list[tuple[str, float, str]]:
    """Name, value and unit of each axis' random walk."""
    return [
        (f"walk_{a}_nm_per_root_s", v, "nm/√s")
        for a, v in zip("xyz", experiment.stage.unsubtracted_nm_per_root_s, strict=True)
    ]


_REMEDY = "use a reference bead nearer to this one, or let the stage settle before recording."
EFFECT = Effect(
    "drift", _hypotheses, _cause, walks, remedy=_REMEDY, unnamed=("power_law", ("x", "y", "z"))
)
