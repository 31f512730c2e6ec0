"""The experiment to simulate: what the setup states, with the effects that it lists and sizes."""

from __future__ import annotations

from collections.abc import Sequence

from mtpipe.effects.catalogue import catalogue
from mtpipe.effects.effect import Effect, Evidence
from mtpipe.effects.setup_sizes import pinned_sizes, read_sizes, with_pinned
from mtpipe.experiment.description import Experiment, ForceCourse, Triple
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.ground.notice import Notice
from mtpipe.setup.setup import Setup
from mtpipe.setup.tables import DESCRIBED

# Arbitrary line and course: they make hypotheses from which names of sizes are read where the setup
# states none.
SOME_LINE_HZ, SOME_COURSE = (1.0,), ForceCourse(0.01)


def stated_experiment(
    setup: Setup,
    forces_pN: Sequence[float],
    frames: int,
    *,
    noise_nm: Triple | None = None,
    beads: int = 1,
    lost_share: float = 0.0,
) -> tuple[Experiment, tuple[Notice, ...]]:
    """The experiment that a setup states, at these forces.

    Effects that the setup lists are in it if `[model.<effect>]` states all their sizes.

    Parameters
    ----------
    Those of `experiment_of`.

    Returns
    -------
    The experiment, and notices of what was assumed and of effects that it does not contain.

    Raises
    ------
    SetupError : as `experiment_of`, or a size cannot be pinned.
    """
    experiment, notices = experiment_of(
        setup, forces_pN, frames, noise_nm=noise_nm, beads=beads, lost_share=lost_share
    )
    sizes = pinned_sizes(setup)
    listed = (set(setup.model.effects) | set(sizes)) - set(DESCRIBED)
    reasons = dict.fromkeys(listed, "which no simulation has")
    for effect in catalogue():
        if effect.name in listed:
            experiment, reasons[effect.name] = _with_effect(
                experiment, effect, sizes.get(effect.name, {})
            )
    left_out = [f"{name}, {reason}" for name, reason in sorted(reasons.items()) if reason]
    if not left_out:
        return experiment, notices
    said = f"The simulation does not contain {'; '.join(left_out)}."
    return experiment, (*notices, Notice("effects_not_simulated", "caution", said))


def _with_effect(
    experiment: Experiment, effect: Effect, sizes: dict[str, float]
) -> tuple[Experiment, str]:
    """The experiment with an effect; as it is, and why, if not all sizes are stated."""
    forces = tuple(rest.force_pN for rest in experiment.rests)
    some = Evidence(SOME_LINE_HZ, forces, common_course=SOME_COURSE)
    held, evidence = read_sizes(effect, sizes, some)
    possible = with_pinned(effect, held).hypotheses(experiment, evidence)
    if not possible:
        return experiment, "which does not apply to this setup"
    changed, free = possible[0].experiment, possible[0].parameters
    missing = [name for name, _, _ in effect.strengths(changed) if name not in sizes]
    unread = effect.read is not None and effect.read.name in missing
    if unread or any(parameter.prior is None for parameter in free):
        return experiment, f"of which [model.{effect.name}] does not state {', '.join(missing)}"
    for parameter in free:
        if parameter.prior is not None:
            changed = parameter.change(changed, parameter.prior[0])
    return changed, ""
