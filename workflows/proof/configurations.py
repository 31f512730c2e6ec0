"""Drawn experiments for the proof: what a laboratory might have, and the setup that says so.

Everything that is drawn is rounded as the setup writes it, so that a clean recording is exactly
what its setup says. What no setup states (noise, stage, the chain's formula) is in the experiment
alone.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mtpipe.experiment.description import Experiment, Stage
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.physics.tether import Formula
from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.usual_errors import exact, usual_stderr
from mtpipe.simulation.simulate import Engine

EXPOSURES = (0.3, 1.0)
RADII_NM, CONTOURS_NM = (500.0, 1400.0), (1000.0, 7000.0)
HIGHEST_PN = (8.0, 20.0)
PLATEAUS = (4, 8)
NOISE_NM, AXIAL_NOISE = (0.5, 3.0), 1.5
LISTED = {"wall_drag": 0.75, "rotation_coupling": 0.8, "tracking_noise": 0.85}
# Step by step, chain and surface are what they are at every height.
ALWAYS_BROWNIAN = "anharmonic_tether"


@dataclass(frozen=True)
class Regime:
    """Where experiments are drawn from: frame rates, and the lowest force."""

    rates_hz: tuple[float, float] = (58.0, 400.0)
    lowest_pN: tuple[float, float] = (0.3, 0.8)


# What most laboratories do, and where some effects are to be seen at all.
REGIMES = {
    "usual": Regime(),
    "fast camera": Regime(rates_hz=(1500.0, 6000.0), lowest_pN=(2.0, 4.0)),
    "low force": Regime(lowest_pN=(0.04, 0.2)),
}


@dataclass(frozen=True)
class Configuration:
    """A setup, as its TOML content, and the experiment that is exactly what it says."""

    content: dict[str, Any]
    experiment: Experiment

    @property
    def setup(self) -> Setup:
        """The setup, read."""
        return parse_setup(self.content, where="proof")

    @property
    def listed(self) -> tuple[str, ...]:
        """Effects that the setup lists."""
        return tuple(self.content["model"]["effects"])


def draw(
    random: np.random.Generator,
    frames: int,
    *,
    plateaus: int | None = None,
    listed: Collection[str] = (),
    formula: Formula | None = "marko-siggia",
    regime: str = "usual",
) -> Configuration:
    """Draw a configuration.

    Parameters
    ----------
    frames : per plateau. plateaus : their number; None: drawn.
    listed : effects that the setup lists in any case.
    formula : of the chain, which no setup states; None: drawn.
    regime : one of `REGIMES`.
    """
    here = REGIMES[regime]
    rate_hz = round(_log_uniform(random, here.rates_hz), 2)
    radius_nm = float(random.choice(RADII_NM))
    effects = sorted({name for name, p in LISTED.items() if random.random() < p} | set(listed))
    number = int(random.integers(PLATEAUS[0], PLATEAUS[1] + 1)) if plateaus is None else plateaus
    content = exact(
        {
            "schema": 1,
            "camera": {
                "frame_rate_hz": rate_hz,
                "exposure_s": math.floor(1e7 * random.uniform(*EXPOSURES) / rate_hz) / 1e7,
                "pixel_size_nm": round(random.uniform(80.0, 150.0), 1),
            },
            "beads": {"radius_nm": radius_nm, "reference": ["ref1"]},
            "tether": {
                "contour_length_nm": round(_log_uniform(random, CONTOURS_NM)),
                "persistence_length_nm": 50.0,
            },
            "buffer": {
                "temperature_K": round(random.uniform(293.0, 300.0), 2),
                "viscosity_mPa_s": round(random.uniform(0.85, 1.0), 3),
            },
            "field": {"direction": str(random.choice(["x", "y"]))},
            "model": {"effects": effects},
            # at the highest rates the plateaus are short
            "plateaus": {"minimum_s": min(5.0, round(0.8 * frames / rate_hz, 2))},
        }
    )
    return Configuration(content, _experiment(content, frames, number, formula, random, here))


def unlisted(configuration: Configuration, effect: str) -> Configuration:
    """The configuration whose setup, and the experiment with it, does not have an effect."""
    listed = [name for name in configuration.listed if name != effect]
    without = configuration.experiment
    if effect == "wall_drag":
        without = replace(without, fluid=replace(without.fluid, wall=False))
    elif effect == "rotation_coupling":
        without = replace(without, bead=replace(without.bead, turns=False))
    elif effect == "tracking_noise":
        quiet = replace(without.tracker, noise_nm=(0.0,) * 3, reference_noise_nm=(0.0,) * 3)
        without = replace(without, tracker=quiet)
    elif effect == ALWAYS_BROWNIAN:
        without = replace(without, anharmonic=False)
    else:
        raise ValueError(f"{effect} is not a matter of being listed")
    return Configuration(configuration.content | {"model": {"effects": listed}}, without)


def with_usual_errors(
    content: dict[str, Any], random: np.random.Generator
) -> tuple[dict[str, Any], dict[str, float]]:
    """What a laboratory would write that knows its values as well as laboratories do.

    Every stated value is off by its usual error and has none stated beside it; the frame rate,
    which the times of the recording tell, stays. Relative errors by key are returned as well.
    """
    stated, errors = dict(content), {}
    for table, values in content.items():
        if isinstance(values, dict):
            stated[table] = {k: v for k, v in values.items() if not k.endswith("_stderr")}
            for key, value in stated[table].items():
                stderr = usual_stderr(key, value) if isinstance(value, float | int) else 0.0
                if stderr > 0 and key != "frame_rate_hz":
                    stated[table][key] = round(value + stderr * random.normal(), 7)
                    errors[key] = stated[table][key] / value - 1
    camera = stated["camera"]
    most = math.floor(1e7 / camera["frame_rate_hz"]) / 1e7
    camera["exposure_s"] = min(camera["exposure_s"], most)
    return stated, errors


def brownian(configuration: Configuration) -> Configuration:
    """The configuration whose setup knows that chain and surface are not linear."""
    listed = [*configuration.listed, ALWAYS_BROWNIAN]
    return Configuration(
        configuration.content | {"model": {"effects": listed}},
        replace(configuration.experiment, anharmonic=True),
    )


def engine_of(true: Experiment) -> Engine:
    """Who simulates an experiment: step by step, but for what that simulator has otherwise.

    Its beads turn about the field's axis in any case, one that is attached beside its lowest point
    and may tilt does not rest upright, and its fluid has no memory.
    """
    otherwise = true.rocks or not true.bead.turns or true.fluid.memory > 0
    return "linear" if otherwise else "brownian"


def toml(content: dict[str, Any]) -> str:
    """A setup's content as the text of its file."""
    lines = [f"schema = {content['schema']}"]
    for section, table in content.items():
        if isinstance(table, dict):
            lines += ["", f"[{section}]", *(f"{key} = {_value(v)}" for key, v in table.items())]
    return "\n".join(lines) + "\n"


def _experiment(
    content: dict[str, Any],
    frames: int,
    plateaus: int,
    formula: Formula | None,
    random: np.random.Generator,
    regime: Regime,
) -> Experiment:
    low, high = _log_uniform(random, regime.lowest_pN), _log_uniform(random, HIGHEST_PN)
    forces = np.geomspace(low, high, plateaus) * np.exp(0.1 * random.uniform(-1, 1, size=plateaus))
    forces = np.minimum(forces, HIGHEST_PN[1])[:: int(random.choice([-1, 1]))]
    noise = _log_uniform(random, NOISE_NM) if "tracking_noise" in content["model"]["effects"] else 0
    stage = Stage(
        steady_nm_per_s=_triple(random.uniform(-0.3, 0.3, size=3)),
        random_nm_per_root_s=_triple(random.uniform(0.3, 1.5, size=3)),
    )
    drawn: Formula = "marko-siggia" if random.random() < 0.5 else "bouchiat"
    experiment, _ = experiment_of(
        parse_setup(content, where="proof"),
        [float(force) for force in forces],
        frames,
        noise_nm=(noise, noise, AXIAL_NOISE * noise),
        stage=stage,
        lost_share=float(random.choice([0.0, 0.0, 0.003, 0.02])),
        formula=formula or drawn,
    )
    return experiment


def _log_uniform(random: np.random.Generator, ends: tuple[float, float]) -> float:
    return math.exp(random.uniform(math.log(ends[0]), math.log(ends[1])))


def _triple(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _value(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return "[" + ", ".join(_value(one) for one in value) + "]"
    return repr(value)
