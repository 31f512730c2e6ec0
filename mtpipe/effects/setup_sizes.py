"""Sizes of effects that the setup pins in `[model.<effect>]`: they are taken, and not fitted.

They go by the names under which the diagnosis reports them. Those of tracking noise are apart, as
the description of every experiment has it (`mtpipe.experiment.from_setup`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from scipy import optimize

from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.parameter import Parameter
from mtpipe.ground.errors import SetupError
from mtpipe.setup.setup import Setup
from mtpipe.setup.tables import DESCRIBED, NOISE


def pinned_sizes(setup: Setup) -> dict[str, dict[str, float]]:
    """Sizes that `[model.<effect>]` pins, by effect and name; those of tracking noise apart.

    Raises
    ------
    SetupError : one is no number.
    """
    tables = {k: v for k, v in (setup.model.model_extra or {}).items() if k != NOISE}
    for effect, table in tables.items():
        for name, size in table.items():
            if not isinstance(size, (int, float)):
                raise SetupError(
                    f"[model.{effect}] {name} = {size!r} is no number",
                    mend="Write one, or leave it out: it is fitted then.",
                )
        if table and effect in DESCRIBED:
            raise SetupError(f"[model.{effect}] {min(table)} is no size that can be pinned")
    return {k: {name: float(size) for name, size in v.items()} for k, v in tables.items()}


def read_sizes(
    effect: Effect, sizes: Mapping[str, float], evidence: Evidence
) -> tuple[dict[str, float], Evidence]:
    """Take what the setup says of a size that is read (`Effect.read`) for what was seen.

    Returns
    -------
    The sizes that are left to be held, and the evidence.
    """
    left = dict(sizes)
    read = effect.read
    if read is not None and read.name in left:
        evidence = read.seen(evidence, left[read.name])
        if not read.fitted:
            del left[read.name]
    return left, evidence


def with_pinned(effect: Effect, sizes: Mapping[str, float]) -> Effect:
    """The effect with some of its sizes held.

    Parameters
    ----------
    sizes : by name, in the unit that the effect reports it in.

    Raises
    ------
    SetupError : its hypotheses do, where a size has no such name or cannot be.
    """
    return replace(effect, hypotheses=partial(_hypotheses, effect, dict(sizes)))


def _hypotheses(
    effect: Effect, sizes: Mapping[str, float], experiment: Experiment, evidence: Evidence
) -> Sequence[Hypothesis]:
    found = list(effect.hypotheses(experiment, evidence))
    for name, size in sizes.items():
        held = [_held(effect, hypothesis, name, size) for hypothesis in found]
        able = [one for one in held if one is not None]
        if found and not able:
            known = [effect.strengths(one.experiment) for one in found]
            names = ", ".join(dict.fromkeys(name for sizes in known for name, _, _ in sizes))
            raise SetupError(
                f"[model.{effect.name}] {name} is no size that can be pinned",
                mend=f"It has {names}." if names else "It has none.",
            )
        found = able
    return found


def _held(effect: Effect, hypothesis: Hypothesis, name: str, size: float) -> Hypothesis | None:
    """The hypothesis without the parameter that sets this size, which is what it is to be.

    None where it has no such size.
    """
    for parameter in hypothesis.parameters:
        short = partial(_short, effect, hypothesis.experiment, parameter, name, size)
        lowest, highest = short(parameter.lower), short(parameter.upper)
        if lowest == highest:
            continue
        if lowest * highest > 0:
            limits = sorted((lowest + size, highest + size))
            raise SetupError(
                f"[model.{effect.name}] {name} = {size:g} cannot be",
                mend=f"Write a number between {limits[0]:.4g} and {limits[1]:.4g}.",
            )
        value = optimize.brentq(short, parameter.lower, parameter.upper, xtol=1e-12, rtol=1e-12)
        return replace(
            hypothesis,
            experiment=parameter.change(hypothesis.experiment, float(value)),
            parameters=tuple(other for other in hypothesis.parameters if other is not parameter),
        )
    return None


def _short(
    effect: Effect,
    experiment: Experiment,
    parameter: Parameter,
    name: str,
    size: float,
    value: float,
) -> float:
    """By how much a size misses what it is to be with a parameter at a value; 0 without it."""
    changed = parameter.change(experiment, value)
    sizes = {known: strength for known, strength, _ in effect.strengths(changed)}
    return sizes[name] - size if name in sizes else 0.0
