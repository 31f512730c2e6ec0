"""`mismatch.json` (FORMATS section 4): what was found, as plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.calibration.recommended_force import BeadForces
from mtpipe.crosschecking.beads import Outcomes, check_of, per_bead
from mtpipe.crosschecking.crosscheck import CrossCheck
from mtpipe.diagnosis import before_after, unexplained_content
from mtpipe.diagnosis.beads_together import beads_together
from mtpipe.diagnosis.corrections.correction import Strength
from mtpipe.diagnosis.excerpt import excerpt
from mtpipe.diagnosis.explain import explain, explain_by_excerpt
from mtpipe.diagnosis.explanation import Explanation, Named
from mtpipe.diagnosis.forces_to_quote import diagnosed_forces
from mtpipe.diagnosis.location import MOST_PLACES, bent_heights, located
from mtpipe.diagnosis.sentence import sentence
from mtpipe.diagnosis.unexplained import Unexplained
from mtpipe.ground.processes import Workers, executor, tell
from mtpipe.ground.progress import by_name
from mtpipe.ground.shown import Shown
from mtpipe.ground.steps import Steps, finished
from mtpipe.ground.types import NamedProgress
from mtpipe.joint_fit.hypotheses import FittedEffect
from mtpipe.recording.recording import Recording
from mtpipe.states import with_states

SCHEMA = "mtpipe.mismatch/1"


@dataclass(frozen=True, repr=False)
class Mismatch(Shown):
    """The diagnosis of a recording, FORMATS section 4 as an object.

    Attributes
    ----------
    recording : its name.
    beads : what was found about each tethered bead that could be simulated.
    forces : to quote, of these beads.
    tolerance : share of a force that matters, of the setup's `[report]`.
    refused : what is wrong with the data of others.
    failed : faults of the program at others, in words.
    """

    recording: str
    beads: Mapping[str, Explanation]
    forces: Mapping[str, BeadForces]
    tolerance: float
    refused: Mapping[str, str]
    failed: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        found = []
        for bead, one in self.beads.items():
            causes = " and ".join(named.name for named in one.named_once)
            found.append(f"{bead} {one.verdict}{f' by {causes}' if causes else ''}")
        refused = [f"{bead} not simulated" for bead in self.refused]
        return f"Mismatch of {self.recording}: {', '.join([*found, *refused]) or 'no beads'}"

    @property
    def table(self) -> pd.DataFrame:
        """A row per bead and plateau: verdict, causes, and forces (pN) as in `mismatch.json`."""
        rows: list[dict[str, Any]] = []
        for bead, one in self.beads.items():
            causes = ";".join(named.name for named in one.named_once)
            said = {"bead": bead, "verdict": one.verdict, "effects": causes}
            rows += [said | force for force in _forces(one, self.forces[bead])]
        return pd.DataFrame(rows)

    @property
    def crosscheck(self) -> CrossCheck:
        """The cross-check that it began with, as `mtpipe.crosscheck` makes it."""
        checks = {bead: one.before for bead, one in self.beads.items()}
        return CrossCheck(self.recording, checks, self.refused, self.failed)

    def as_dict(self) -> dict[str, Any]:
        """The content of `mismatch.json`."""
        return content(self.recording, self.beads, self.forces, self.tolerance)

    @property
    def unexplained(self) -> dict[str, Unexplained]:
        """Place, size and shape of what is left, of beads that are unexplained."""
        found = {bead: one.unexplained for bead, one in self.beads.items()}
        return {bead: left for bead, left in found.items() if left is not None}


@dataclass(frozen=True)
class Examined:
    """Cross-check and diagnosis of a recording as they are written.

    Attributes
    ----------
    checked : the cross-check. found : about each bead that could be simulated.
    before_after, unexplained : content of `details/before_after.json` and
        `details/unexplained.json`, by bead.
    """

    checked: CrossCheck
    found: Mapping[str, Explanation]
    before_after: dict[str, dict[str, Any]]
    unexplained: dict[str, dict[str, Any]]


def diagnose(
    recording: Recording,
    *,
    seed: int = 0,
    workers: Workers = 1,
    progress: NamedProgress | None = None,
) -> Mismatch:
    """Cross-check every tethered bead and explain what differs.

    Parameters
    ----------
    recording : with the drift subtracted (`mtpipe.subtract_drift`).
    seed : of the simulations.
    workers : processes, or an executor, over which beads are spread.
    progress : called with (step, beads done, of how many); default: a bar in a notebook.

    Raises
    ------
    Nothing for what goes wrong at one bead: that is in `refused` or `failed`.
    """
    recording = with_states(recording)
    say = by_name(progress)
    total = len(recording.tethered)
    with executor(workers, most=total, hear=lambda step: say(step, 0, total)) as pool:
        found = finished(explaining(recording, pool, seed=seed, progress=say))
    forces = diagnosed_forces(recording, found.results, seed=seed)
    tolerance = recording.setup.report.tolerance
    return Mismatch(recording.name, found.results, forces, tolerance, found.refused, found.failed)


def examining(
    recording: Recording,
    pool: Executor,
    *,
    seed: int,
    parts: int = 1,
    progress: NamedProgress,
) -> Steps[Examined]:
    """Cross-check and diagnosis of all beads as they are written, in steps.

    Parameters : as `explaining`.
    """
    beads = yield from explaining(
        recording, pool, seed=seed, parts=parts, with_curves=True, progress=progress
    )
    found = beads.results
    checks = {bead: one.before for bead, one in found.items()}
    named = {bead: before_after.content_of(one) for bead, one in found.items()}
    left = {bead: one.unexplained for bead, one in found.items()}
    return Examined(
        CrossCheck(recording.name, checks, beads.refused, beads.failed),
        found,
        {bead: drawn for bead, drawn in named.items() if drawn is not None},
        {
            bead: unexplained_content.content_of(rest)
            for bead, rest in left.items()
            if rest is not None
        },
    )


def explaining(
    recording: Recording,
    pool: Executor,
    *,
    seed: int,
    parts: int = 1,
    with_curves: bool = False,
    progress: NamedProgress,
) -> Steps[Outcomes[Explanation]]:
    """What is found about each bead, and about them together, in steps.

    Parameters
    ----------
    recording : whose plateaus are tested for being one state. seed : of the simulations.
    parts : processes over which the simulations of one bead are spread.
    with_curves : keep the curves that are drawn.
    progress : called with (step, done, of how many).
    """
    beads = yield from per_bead(
        recording,
        partial(explained_bead, with_curves=with_curves),
        pool,
        seed=seed,
        parts=parts,
        progress=lambda done, total: progress("cross-checking beads", done, total),
    )
    together = yield from beads_together(
        beads.results,
        pool,
        seed=seed,
        progress=lambda done, total: progress("what beads share", done, total),
    )
    return replace(beads, results=together)


def explained_bead(
    recording: Recording, bead: str, random: np.random.Generator, *, with_curves: bool
) -> Explanation:
    """What is found about one bead; the work that is sent to a process.

    Parameters
    ----------
    recording : drift subtracted. bead : its name. random : of the simulations.
    with_curves : keep the curves that are drawn.

    Raises
    ------
    FitError : the bead cannot be compared with simulations, with the reason.
    """

    def say(step: str) -> None:
        tell(f"{recording.name} {bead}: {step}")

    say("comparing with simulations")
    check = check_of(recording, bead, random, with_curves=with_curves)
    shorter = excerpt(recording, check)
    if shorter is None:
        found = explain(check, random, progress=say)
    else:
        part = check_of(shorter, bead, random)
        found = explain_by_excerpt(check, part, random, progress=say)
    # these cached values take long, so they are computed here, where beads run in parallel
    _ = found.unexplained, found.force_stderr_pN
    return found


def content(
    recording: str,
    found: Mapping[str, Explanation],
    forces: Mapping[str, BeadForces],
    tolerance: float,
) -> dict[str, Any]:
    """`mismatch.json` from what was found about each bead, and the forces to quote."""
    beads = {bead: bead_content(one, forces[bead], tolerance) for bead, one in found.items()}
    return {"schema": SCHEMA, "recording": recording, "beads": beads}


def bead_content(found: Explanation, forces: BeadForces, tolerance: float) -> dict[str, Any]:
    """What `mismatch.json` says of one bead."""
    return {
        "verdict": found.verdict,
        "located": _located(found),
        "effects": _each_once(
            [_effect(found, one) for one in sorted(found.effects, key=_oddity_left)]
        ),
        "terms": [_term(found, one) for one in sorted(found.terms, key=_oddity_left)],
        "force_bound_percent": forces.bound_percent,
        "material": forces.exceeds(tolerance),
        "forces": _forces(found, forces),
    }


def _located(found: Explanation) -> list[dict[str, Any]]:
    """Where recording and simulation differ, heights above a bend of z's scale among it."""
    if found.verdict == "consistent":
        return []
    places = located(found.before)
    if found.unexplained is not None and found.unexplained.bend is not None:
        places = [*places, bent_heights(found.before, found.unexplained.bend)]
    return sorted(places, key=lambda place: place["p_value"])[:MOST_PLACES]


def _oddity_left(one: Named) -> float:
    """ln of the p-value without an effect over that with it; small where it explains much."""
    return math.log(max(one.before.p_value, 1e-300) / max(one.after.p_value, 1e-300))


def _effect(found: Explanation, one: Named) -> dict[str, Any]:
    return {
        "effect": one.name,
        "probability": one.probability,
        **_size_and_gain(found, one),
        "equivalent": list(one.equivalent),
    }


def _each_once(effects: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Effects with one entry for each name: what is seen in traces and in spectra is one cause.

    Of two entries the one of the fit counts, with the sentences of both, and the parameters that
    only the other has.
    """
    found: dict[str, dict[str, Any]] = {}
    for one in effects:
        other = found.setdefault(one["effect"], one)
        if other is not one:
            main, rest = (one, other) if other["delta_bic"] is None else (other, one)
            found[one["effect"]] = main | {
                "sentence": f"{main['sentence']} {rest['sentence']}",
                "parameters": rest["parameters"] | main["parameters"],
                "p_before": min(main["p_before"], rest["p_before"]),
                "p_after": max(main["p_after"], rest["p_after"]),
            }
    return list(found.values())


def _term(found: Explanation, one: Named) -> dict[str, Any]:
    form = one.found.effect if isinstance(one.found, FittedEffect) else one.found
    return {
        "form": form.form,
        "axes": list(form.axes),
        "plateaus": [plateau.number for plateau in found.before.case.plateaus],
        **_size_and_gain(found, one),
    }


def _size_and_gain(found: Explanation, one: Named) -> dict[str, Any]:
    return {
        "sentence": sentence(found, one),
        "parameters": {
            strength.name: {
                "value": strength.value,
                "stderr": strength.stderr,
                "unit": strength.unit,
            }
            for strength in _strengths(found, one)
        },
        "delta_bic": float(-2 * one.found.net) if isinstance(one.found, FittedEffect) else None,
        "heldout_gain_nats": one.heldout_gain if math.isfinite(one.heldout_gain) else None,
        "p_before": one.before.p_value,
        "p_after": one.after.p_value,
    }


def _strengths(found: Explanation, one: Named) -> list[Strength]:
    if not isinstance(one.found, FittedEffect):
        return list(one.found.strengths)
    fit, first = found.fit, found.fit.model.plateaus
    effect = one.found.effect
    here = effect.strengths(fit.model.described(fit.theta))
    covariance = fit.covariance[first:, first:]
    slopes = np.zeros((len(here), len(fit.model.parameters)))
    for k, parameter in enumerate(fit.model.parameters):
        step, theta = parameter.step_from(fit.theta[first + k]), fit.theta.copy()
        theta[first + k] += step
        there = effect.strengths(fit.model.described(theta))
        slopes[:, k] = [(b[1] - a[1]) / step for a, b in zip(here, there, strict=True)]
    errors = np.sqrt(np.maximum(np.einsum("ik,kl,il->i", slopes, covariance, slopes), 0.0))
    return [
        Strength(name, float(value), float(error), unit)
        for (name, value, unit), error in zip(here, errors, strict=True)
    ]


def _forces(found: Explanation, forces: BeadForces) -> list[dict[str, Any]]:
    """The force to quote of each plateau, and the one of the setup as it was configured."""
    rows = []
    for plateau in found.before.case.plateaus:
        quoted = forces.recommended[plateau.number].force
        configured = forces.configured[plateau.number]
        rows.append(
            {
                "plateau": plateau.number,
                "magnet_mm": plateau.magnet_mm,
                "force_pN": _number(quoted.value),
                "stderr_pN": _number(quoted.stderr),
                "force_before_pN": _number(configured.value),
                "stderr_before_pN": _number(configured.stderr),
            }
        )
    return rows


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
