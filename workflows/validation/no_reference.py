"""Recordings without a reference bead, on mtpipe's own typical stage: do the intervals hold?

The stage wanders, and nothing takes it off: it is in every extension since z = 0, which was true
when the recording began. Everything else is as the setup says, but for the tether's lengths, which
it calls unknown. Of each recording the first bead counts; others only show the same stage.
"""

from __future__ import annotations

import math
import sys
import tempfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from report import percent
from scipy import stats

import mtpipe
from mtpipe.calibration.bead_results import BeadResult
from mtpipe.curves.extension_curve import ForceExtension, fit_curves
from mtpipe.curves.tether_curves import extension_points, tether_curves
from mtpipe.experiment.from_setup import TYPICAL_STAGE
from mtpipe.experiment.state import bead_state
from mtpipe.fit.points import Assay
from mtpipe.setup.conditions import Conditions
from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.usual_errors import exact
from mtpipe.simulation.setup_experiment import stated_experiment
from mtpipe.simulation.simulate import simulate_experiment
from mtpipe.simulation.written import canonical_csv

sys.path.append(str(Path(__file__).parents[1] / "common"))
from pages import table

NOISE_NM = (1.5, 1.5, 2.5)
# What an interval of one standard error of a normal law holds.
CENTRAL = 0.683


@dataclass(frozen=True)
class World:
    """Truth of one recording, but for its stage, which is `TYPICAL_STAGE`."""

    content: dict[str, Any]
    forces_pN: tuple[float, ...]
    frames: int
    beads: int

    @classmethod
    def draw(cls, random: np.random.Generator) -> World:
        """One of the configurations of the study: 20 to 140 s at each of four to six forces."""
        rate_hz = math.exp(random.uniform(math.log(58), math.log(200)))
        forces = np.geomspace(
            random.uniform(0.2, 0.6), random.uniform(4.0, 9.0), random.integers(4, 7)
        )
        if random.random() < 0.5:
            random.shuffle(forces)
        rotation = ["rotation_coupling"] * bool(random.random() < 0.5)
        content = {
            "schema": 1,
            "camera": {
                "frame_rate_hz": rate_hz,
                "exposure_s": random.uniform(0.3, 0.99) / rate_hz,
            },
            "beads": {"radius_nm": float(random.choice([500.0, 1400.0])), "reference": []},
            "tether": {
                "contour_length_nm": math.exp(random.uniform(math.log(1000), math.log(16_000))),
                "persistence_length_nm": random.uniform(45.0, 55.0),
            },
            "buffer": {
                "temperature_K": random.uniform(294.0, 300.0),
                "viscosity_mPa_s": random.uniform(0.85, 0.95),
            },
            "field": {"direction": str(random.choice(["x", "y"]))},
            "model": {"effects": ["wall_drag", "tracking_noise", *rotation]},
        }
        return cls(
            content, tuple(forces.tolist()), int(random.integers(4096, 8193)), random.integers(1, 4)
        )

    @property
    def setup(self) -> Setup:
        """All that is true."""
        return parse_setup(exact(self.content))

    @property
    def told(self) -> Setup:
        """What the analysis is told: the tether's lengths are unknown."""
        lengths = {"contour_length_nm": "unknown", "persistence_length_nm": "unknown"}
        return parse_setup(exact(self.content | {"tether": lengths}))


def measure(job: tuple[int, int]) -> list[dict[str, Any]]:
    """Rows of one recording from (seed, repeat): a row per number with an interval, against truth,
    with the stage's motion in its error and without."""
    seed, repeat = job
    random = np.random.default_rng([seed, zlib.crc32(b"no_reference"), repeat])
    world = World.draw(random)
    experiment, _ = stated_experiment(
        world.setup, world.forces_pN, world.frames, noise_nm=NOISE_NM, beads=world.beads
    )
    made = simulate_experiment(experiment, world.setup, random)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "recording.csv"
        file.write_bytes(canonical_csv(made))
        recording = mtpipe.subtract_drift(mtpipe.load(file, world.told))
    calibration = mtpipe.calibrate(recording, seed=repeat)
    bead = calibration.beads[0]
    rows = []
    for plateau, force in zip(bead.plateaus, world.forces_pN, strict=True):
        number = plateau.plateau.number
        places = {0: "first plateau", len(bead.plateaus) - 1: "last plateau"}
        where = places.get(number, "between")
        error = plateau.extension_nm - bead_state(experiment, force).extension_nm
        rows.append({
            "what": f"extension, {where}",
            "pull": error / plateau.extension_stderr_nm,
            "holds": abs(error) < plateau.extension_stderr_nm,
            "relative": plateau.extension_stderr_nm / plateau.extension_nm,
            "pull_without": error / plateau.own_stderr_nm,
        })  # fmt: skip
        one = plateau.axes[calibration.conditions.along]
        if one.force is not None and math.isfinite(one.force.value):
            rows.append({"what": "force", **_against(one.force.interval, force)})
    curve = tether_curves(calibration).get(bead.bead)
    without = without_stage(bead, calibration.conditions)
    tether = world.setup.tether
    for name in ("contour_length_nm", "persistence_length_nm"):
        truth = getattr(tether, name).value
        row = {"what": name.split("_")[0]}
        if curve is not None and curve.recommended is not None:
            row |= _against(getattr(curve.recommended, name).interval, truth)
        if without.recommended is not None:
            against = _against(getattr(without.recommended, name).interval, truth)
            row["pull_without"] = against["pull"]
        rows.append(row)
    left = recording.drift.left_along_z
    said = [notice.code for notice in recording.notices]
    told = math.nan if left is None else left.random_nm_per_root_s
    rows.append({"what": "stage", "strength": told, "told": "drift_left" in said})
    return [row | {"repeat": repeat} for row in rows]


def without_stage(bead: BeadResult, conditions: Conditions) -> ForceExtension:
    """The curve as it would be if the stage stood still: the negative control."""
    points = extension_points(bead, conditions)
    alone = replace(points, extension_stderr_nm=points.own_stderr_nm, stage_nm2=None)
    assay = Assay(conditions.temperature_K, bead_turns=conditions.rotation)
    return fit_curves({bead.bead: (alone, assay)})[bead.bead]


def _against(interval: tuple[float, float], truth: float) -> dict[str, float]:
    """Pull of a positive number, whose interval is symmetric in the logarithm or nearly so."""
    low, high = np.log(interval)
    return {
        "pull": float(((low + high) / 2 - math.log(truth)) / ((high - low) / 2)),
        "relative": float((high - low) / 2),
        "holds": interval[0] < truth < interval[1],
    }


def coverage_table(outcomes: Sequence[list[dict[str, Any]]]) -> str:
    """How often 68 % intervals hold the truth, with the stage's motion in them and without."""
    rows = pd.DataFrame([row for outcome in outcomes for row in outcome])
    lines = []
    for what, one in rows[rows.what != "stage"].groupby("what", sort=False):
        got, alone = one.pull.dropna(), one.pull_without.dropna()
        lines.append([
            str(what), f"{len(got)} of {len(one)}", percent(one.holds.dropna()),
            f"{got.median():+.2f}", f"{math.sqrt(np.mean(got**2)):.2f}",
            f"{one.relative.median():.2%}",
            percent(alone.abs() < 1), f"{math.sqrt(np.mean(alone**2)):.1f}" if len(alone) else "–",
        ])  # fmt: skip
    low, high = stats.binom.interval(0.95, len(outcomes), CENTRAL) / np.float64(len(outcomes))
    stage = rows[rows.what == "stage"]
    strength = stage.strength / TYPICAL_STAGE.random_nm_per_root_s[2]
    return "\n\n".join([
        table(
            "number | known | within 68 % (%) | median pull | rms pull | median error"
            " | within 68 % without the stage's motion (%) | rms pull without it",
            lines,
        ),
        f"{len(outcomes)} recordings: of that number of independent intervals that hold 68 %, "
        f"{low:.0%} to {high:.0%} hold the truth in 95 of 100 such studies. Extensions of a "
        "recording share the stage's motion. Its strength is found at "
        f"{strength.median():.2f} times the true one (16 to 84 % of recordings: "
        f"{strength.quantile(0.16):.2f} to {strength.quantile(0.84):.2f}), and told in "
        f"{percent(stage.told)} % of them.",
    ])  # fmt: skip
