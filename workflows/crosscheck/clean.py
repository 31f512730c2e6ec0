"""Clean recordings of varied configurations: everything is as the setup says.

What a setup lists is in the simulation, and what it does not list is not. `measure` sends one
through the same steps as `mtpipe run`: drift subtraction, the fit, the simulated counterparts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mtpipe.crosschecking.check import BeadCheck, check_bead
from mtpipe.crosschecking.prepared_bead import PreparedBead, prepare
from mtpipe.drift import subtract_drift
from mtpipe.experiment.description import Experiment, Rest
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.ground.types import FloatArray
from mtpipe.physics.tether import Formula
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.usual_errors import exact
from mtpipe.simulation.simulate import Engine, simulate_experiment

BROWNIAN_SHARE = 0.2
# Step by step the surface is there and the tether is not linear, which no setup of the study lists:
# forces are not low ones (`mtpipe.experiment.state.LOW_TILT`).
LEAST_PN = 0.3
Change = Callable[[Experiment, np.random.Generator], Experiment]
Spoil = Callable[[Recording, np.random.Generator], Recording]


@dataclass(frozen=True)
class Clean:
    """One configuration: what the setup says, the experiment, and who simulates it."""

    setup: Setup
    experiment: Experiment
    engine: Engine


def draw(
    random: np.random.Generator, *, engine: Engine | None = None, frames: tuple[int, int] = (11, 13)
) -> Clean:
    """Draw a configuration.

    Parameters
    ----------
    engine : None: Brownian dynamics for a share of them.
    frames : plateaus have from 2^first to 2^last frames, each its own number.
    """
    chosen: Engine = "brownian" if random.random() < BROWNIAN_SHARE else "linear"
    chosen = engine or chosen
    rate_hz = math.exp(random.uniform(math.log(58), math.log(400)))
    listed = [
        name
        for name, share in (("wall_drag", 0.6), ("rotation_coupling", 0.6), ("tracking_noise", 0.7))
        # step by step a bead always turns
        if random.random() < share or (chosen == "brownian" and name == "rotation_coupling")
    ]
    setup = parse_setup(
        exact(
            {
                "schema": 1,
                "camera": {
                    "frame_rate_hz": rate_hz,
                    "exposure_s": random.uniform(0.3, 1.0) / rate_hz,
                },
                "beads": {
                    "radius_nm": float(random.choice([500.0, 1400.0])),
                    "reference": ["ref1"],
                },
                "tether": {
                    "contour_length_nm": float(random.choice([1200.0, 2700.0, 7000.0])),
                    "persistence_length_nm": 50.0,
                },
                "buffer": {
                    "temperature_K": random.uniform(294.0, 300.0),
                    "viscosity_mPa_s": random.uniform(0.85, 0.95),
                },
                "field": {"direction": str(random.choice(["x", "y"]))},
                "model": {"effects": listed},
            }
        ),
        where="study",
    )
    plateaus = int(random.integers(4, 9))
    forces = np.geomspace(LEAST_PN, 15.0, plateaus) * np.exp(0.1 * random.normal(size=plateaus))
    forces = forces[:: int(random.choice([-1, 1]))]
    noise = 0.0
    if "tracking_noise" in listed:
        noise = math.exp(random.uniform(math.log(0.7), math.log(4.0)))
    found = configured(
        setup,
        [float(force) for force in forces],
        2048,
        (noise, noise, 1.5 * noise),
        lost_share=float(random.choice([0.0, 0.003, 0.02])),
    )
    experiment = found.experiment
    formula: Formula = "marko-siggia" if random.random() < 0.5 else "bouchiat"
    rests = tuple(
        Rest(rest.force_pN, round(2.0 ** random.uniform(*frames)), rest.magnet_mm)
        for rest in experiment.rests
    )
    experiment = replace(experiment, rests=rests, chain=replace(experiment.chain, formula=formula))
    return Clean(setup, experiment, chosen)


def configured(
    setup: Setup,
    forces_pN: list[float],
    frames: int,
    noise_nm: tuple[float, float, float],
    lost_share: float = 0.0,
) -> Clean:
    """The experiment that a setup describes."""
    experiment, _ = experiment_of(
        setup, forces_pN, frames, noise_nm=noise_nm, lost_share=lost_share
    )
    return Clean(setup, experiment, "linear")


def prepared(
    clean: Clean,
    random: np.random.Generator,
    *,
    change: Change | None = None,
    spoil: Spoil | None = None,
) -> PreparedBead:
    """A simulated bead with the experiment that is fitted to it.

    Parameters
    ----------
    change : of the experiment, unknown to the setup. spoil : of the raw recording.
    """
    experiment = clean.experiment if change is None else change(clean.experiment, random)
    raw = simulate_experiment(experiment, clean.setup, random, engine=clean.engine)
    if spoil is not None:
        raw = spoil(raw, random)
    return prepare(subtract_drift(raw), "b1")


def measure(job: tuple[int, int]) -> dict[str, Any]:
    """Cross-check one clean recording, given the seed of the study and its number."""
    random = np.random.default_rng(job)
    clean = draw(random)
    began = time.process_time()
    found = check_bead(prepared(clean, random), random)
    return {
        "seed": job[0],
        "number": job[1],
        "p_value": found.p_value,
        "simulations": len(found.simulated),
        "seconds": time.process_time() - began,
        "frames": sum(rest.frames for rest in clean.experiment.rests),
        **configuration(clean),
        "scores": [
            [*label, score] for label, score in zip(labels(found), scores(found), strict=True)
        ],
    }


def configuration(clean: Clean) -> dict[str, Any]:
    """What a table of the study is split by."""
    experiment = clean.experiment
    return {
        "engine": clean.engine,
        "formula": experiment.chain.formula,
        "rate_hz": 1 / experiment.camera.frame_s,
        "radius_nm": experiment.bead.radius_nm,
        "contour_nm": experiment.chain.contour_length_nm,
        "listed": clean.setup.model.effects,
        "force_min_pN": min(rest.force_pN for rest in experiment.rests),
    }


def labels(found: BeadCheck) -> list[tuple[str, str, bool, int]]:
    """Statistic, axis, whether pooled, and band or plateau of every look."""
    return [
        (look.kind, look.axis, look.pooled, -1 if look.pooled else look.plateaus[0])
        for look in found.statistics
    ]


def scores(found: BeadCheck) -> FloatArray:
    """How many simulated standard deviations the recording is from the simulated mean."""
    spread = found.simulated.std(axis=0, ddof=1)
    return np.asarray((found.observed - found.simulated.mean(axis=0)) / np.maximum(spread, 1e-12))
