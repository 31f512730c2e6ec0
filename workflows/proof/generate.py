"""One recording of the proof from a seed and its number, with its answer."""

from __future__ import annotations

import gzip
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import concealed
import configurations
import numpy as np
import outside
import sealing
import strength
from concealed import BY_NAME, Effect, Family
from configurations import Configuration
from plan import NOTHING_CONCEALED, STRENGTHS, Task, strength_of, task

from mtpipe.experiment.description import Experiment
from mtpipe.ground.errors import FitError
from mtpipe.physics.tether import Formula
from mtpipe.recording.recording import Recording
from mtpipe.simulation.written import canonical_csv

TRIES = 30


@dataclass(frozen=True)
class Form:
    """What all recordings of a set have in common.

    Attributes
    ----------
    frames : per plateau. plateaus : their number; None: drawn. digits : of nm that are kept.
    formula : of the chain; None: drawn.
    """

    frames: int = 4096
    plateaus: int | None = None
    digits: int = 3
    formula: Formula | None = "marko-siggia"


@dataclass(frozen=True, eq=False)
class Case:
    """A recording, the text of its setup, and its answer."""

    name: str
    recording: Recording
    setup: str
    answer: dict[str, Any]


@dataclass(frozen=True, eq=False)
class _Hidden:
    """An experiment with something concealed, beside the configured one."""

    configuration: Configuration
    true: Experiment
    effects: tuple[dict[str, Any], ...] = ()
    spoils: tuple[tuple[Effect, float], ...] = ()
    strength: str | None = None
    bias: tuple[float, ...] | None = None


def make(seed: int, number: int, form: Form, wanted: Task | None = None) -> Case:
    """Make a recording.

    Parameters
    ----------
    wanted : what it conceals; None: `task`.
    """
    wanted = wanted or task(seed, number)
    random = np.random.default_rng([seed, number])
    name = f"r{number:04d}"
    hidden = _hidden(wanted, form, random)
    configuration, true = hidden.configuration, hidden.true
    engine = configurations.engine_of(true)
    if engine == "brownian" and not true.anharmonic:
        configuration = configurations.brownian(configuration)
        true = replace(true, anharmonic=True)
    setup = configuration.setup
    scene = outside.Scene(true, setup, engine, int(random.integers(2**32)))
    effects = list(hidden.effects)
    if wanted.kind == "outside":
        found = outside.EFFECTS[wanted.names[0]](scene, random)
        recording = found.recording
        where = {"axes": list(found.axes), "plateaus": found.plateaus, "band_hz": found.band_hz}
        effects = [{"effect": wanted.names[0], "told": found.told, "where": where}]
    else:
        recording = scene.played()
        for effect, amount in hidden.spoils:
            if effect.spoil is not None:
                recording = effect.spoil(recording, hidden.true, amount, random)
    stated, errors = configuration.content, {}
    if wanted.kind == "usual errors":
        stated, errors = configurations.with_usual_errors(stated, random)
        recording = _tracked_with(1 + errors["pixel_size_nm"], recording)
    rests = hidden.true.rests
    answer = {
        "name": name,
        "seed": seed,
        "number": number,
        "kind": wanted.kind,
        "strength": hidden.strength,
        "wanted_strength": wanted.strength,
        "effects": effects,
        "errors": errors,
        "listed": list(configuration.listed),
        "engine": engine if wanted.names not in (("fouling",), ("shortening",)) else "linear",
        "formula": hidden.true.chain.formula,
        "plateaus": [{"magnet_mm": rest.magnet_mm, "force_pN": rest.force_pN} for rest in rests],
        "force_bias": hidden.bias,
        "salt": random.bytes(16).hex(),
    }
    recording = replace(
        recording,
        positions_nm={
            bead: np.round(xyz, form.digits) for bead, xyz in recording.positions_nm.items()
        },
    )
    return Case(name, recording, configurations.toml(stated), answer)


def write(case: Case, recordings: Path, answers: Path) -> str:
    """Write a case's recording and, elsewhere, its answer; returns the answer's hash."""
    folder = recordings / case.name
    folder.mkdir(parents=True, exist_ok=True)
    answers.mkdir(parents=True, exist_ok=True)
    (folder / "setup.toml").write_text(case.setup, encoding="utf-8")
    packed = gzip.compress(canonical_csv(case.recording), 9, mtime=0)
    (folder / "recording.csv.gz").write_bytes(packed)
    text = sealing.text_of(case.answer)
    (answers / f"{case.name}.json").write_text(text, encoding="utf-8")
    return sealing.seal(case.answer)


def _tracked_with(scale: float, recording: Recording) -> Recording:
    """The recording of a camera whose pixels are taken for larger than they are."""
    factors = np.array([scale, scale, 1.0])
    positions = {bead: xyz * factors for bead, xyz in recording.positions_nm.items()}
    return replace(recording, positions_nm=positions)


def penalty(parameters: int, true: Experiment) -> float:
    """What naming costs: half the parameters times ln of the number of ordinates (BIC)."""
    ordinates = 3 * sum(rest.frames // 2 - 1 for rest in true.rests)
    return 0.5 * parameters * math.log(ordinates)


def _hidden(wanted: Task, form: Form, random: np.random.Generator) -> _Hidden:
    """An experiment with what is wanted, drawn until it has the strength, or the nearest."""
    listed = [name for name in wanted.names if name in concealed.LISTING]
    regime = "usual"
    for effect in [BY_NAME[name] for name in wanted.names if name in BY_NAME]:
        regime = effect.regime if effect.regime != "usual" else regime
    if regime == "low force":
        # a bead that does not turn is an approximation that such forces are not for
        listed.append("rotation_coupling")
    best: _Hidden | None = None
    for _ in range(TRIES):
        try:
            configuration = configurations.draw(
                random,
                form.frames,
                plateaus=form.plateaus,
                listed=listed,
                formula=form.formula,
                regime=regime,
            )
            if wanted.kind in (*NOTHING_CONCEALED, "outside"):
                # an experiment that can be
                strength.difference(configuration.experiment, configuration.experiment)
                return _Hidden(configuration, configuration.experiment)
            found = _concealing(wanted, configuration, random)
        except (FitError, ValueError):
            continue
        if found.strength == wanted.strength:
            return found
        if found.strength != "too faint" and best is None:
            best = found
    if best is None:
        raise RuntimeError(f"nothing conceals {' and '.join(wanted.names)} as it should")
    return best


def _concealing(wanted: Task, configuration: Configuration, random: np.random.Generator) -> _Hidden:
    """Conceal effects in a configuration, each in the strength wanted as far as it can be."""
    if wanted.strength is None:
        raise ValueError("a strength is needed")
    effects = [BY_NAME[name] for name in wanted.names]
    listed = configuration.experiment
    for effect in effects:
        if effect.name in concealed.LISTING:
            configuration = configurations.unlisted(configuration, effect.name)
    true = configuration.experiment
    told: list[dict[str, Any]] = []
    spoils: list[tuple[Effect, float]] = []
    reached: list[str] = []
    for effect in effects:
        if effect.spoil is not None:
            amount = random.uniform(*effect.sizes[wanted.strength])
            spoils.append((effect, amount))
            told.append({"effect": effect.name, "size": amount, "unit": effect.unit})
            reached.append(wanted.strength)
            continue
        least, most = STRENGTHS[wanted.strength]
        costs = penalty(effect.parameters, true)
        nats = costs + math.exp(random.uniform(math.log(least), math.log(most)))
        if effect.family is None:
            changed, amount = _listed(effect.name, true, listed), None
            gain = strength.difference(changed, true).nats
            true = changed
            family = None
        else:
            family = effect.family(true, random)
            amount, gain = strength.size_for(nats, _measure(true, family), family.ends)
            true = family.change(true, amount)
        told.append(_told(effect, family, amount, gain))
        reached.append(strength_of(gain - costs))
    apart = strength.difference(true, configuration.experiment)
    weakest = min(reached, key=["too faint", *STRENGTHS].index)
    bias = tuple(float(b) for b in apart.force_bias) if not spoils else None
    return _Hidden(configuration, true, tuple(told), tuple(spoils), weakest, bias)


def _measure(base: Experiment, family: Family) -> Callable[[float], float]:
    return lambda size: strength.difference(family.change(base, size), base).nats


def _listed(name: str, without: Experiment, listed: Experiment) -> Experiment:
    """An experiment with one of the effects that are listed or not."""
    if name == "wall_drag":
        return replace(without, fluid=replace(without.fluid, wall=True))
    if name == "rotation_coupling":
        return replace(without, bead=replace(without.bead, turns=True))
    if name == "anharmonic_tether":
        return replace(without, anharmonic=True)
    return replace(without, tracker=listed.tracker)


def _told(
    effect: Effect, family: Family | None, amount: float | None, nats: float
) -> dict[str, Any]:
    where = {"axes": list("xyz"), "plateaus": None, "band_hz": None}
    if effect.name == "rotation_coupling":
        where["axes"] = ["x", "y"]
    if family is not None:
        where |= {
            "axes": list(family.axes),
            "plateaus": family.plateaus,
            "band_hz": family.band_hz,
        }
    return {
        "effect": effect.name,
        "size": amount,
        "unit": "" if family is None else family.unit,
        "told": {} if family is None else family.told,
        "nats": nats,
        "where": where,
    }
