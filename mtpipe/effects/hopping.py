"""Two-state telegraph motion of the tether's length (PHYSICS E19)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from mtpipe.effects.effect import Effect, Evidence, Hypothesis, logarithm, plain
from mtpipe.experiment.description import Experiment, Hopping
from mtpipe.experiment.parameter import Change, Parameter

STEP_NM, RATE_HZ = 20.0, 3.0
# So fast that a frame sees the mean of both states.
UNSEEN_HZ = 1e9


def _hypotheses(experiment: Experiment, evidence: Evidence) -> list[Hypothesis]:
    if experiment.hopping is not None:
        return []
    forces = sorted(evidence.force_pN)
    found = []
    for force in forces[1:-1:2] or forces:
        start = replace(experiment, hopping=Hopping(STEP_NM, force, RATE_HZ))
        rate = logarithm("rate there", "Hz", RATE_HZ, (0.01, 200.0), _set("rate_hz"))
        found.append(Hypothesis(start, (*_lengths(STEP_NM, force, forces), rate)))
    return found


def _lengths(step_nm: float, half_pN: float, forces: Sequence[float]) -> tuple[Parameter, ...]:
    bounds = (0.5 * min(forces), 2 * max(forces))
    return (
        plain("step", "nm", step_nm, (0.0, 400.0), 0.05, _set("step_nm")),
        logarithm("force of equal states", "pN", half_pN, bounds, _set("half_force_pN")),
    )


def _still(experiment: Experiment) -> Hypothesis:
    """A tether that is longer at high force, and not seen to change."""
    hopping = experiment.hopping or Hopping(STEP_NM, 1.0, RATE_HZ)
    forces = [rest.force_pN for rest in experiment.rests]
    start = replace(experiment, hopping=replace(hopping, rate_hz=UNSEEN_HZ))
    return Hypothesis(start, _lengths(hopping.step_nm, hopping.half_force_pN, forces))


def _set(field: str) -> Change:
    return partial(_change, field)


def _change(field: str, experiment: Experiment, value: float) -> Experiment:
    hopping = experiment.hopping or Hopping(STEP_NM, 1.0, RATE_HZ)
    return replace(experiment, hopping=replace(hopping, **{field: value}))


def _cause(experiment: Experiment) -> str:
    hopping = experiment.hopping
    if hopping is None:
        return "the tether hops"
    return (
        f"the tether hops between two lengths {hopping.step_nm:.1f} nm apart, equally likely at "
        f"{hopping.half_force_pN:.2g} pN, {hopping.rate_hz:.2g} times a second there"
    )


def _strengths(experiment: Experiment) -> list[tuple[str, float, str]]:
    hopping = experiment.hopping
    if hopping is None:
        return []
    return [
        ("step_nm", hopping.step_nm, "nm"),
        ("half_force_pN", hopping.half_force_pN, "pN"),
        ("rate_hz", hopping.rate_hz, "Hz"),
    ]


EFFECT = Effect("hopping", _hypotheses, _cause, _strengths, still=_still)
