"""How often a curve of the look-up table is seen, and told from a tether that is softer.

    python workflows/crosscheck/curved_tables.py --recordings 60 [--seed 1] [--workers 2]

Clean recordings of varied configurations (`clean.draw`) are looked at as they are; with z of one
plateau as a curved table reads it; and with z of that plateau on a spring that is softer at some
heights, of the same distribution. The limits are those of
`mtpipe.diagnosis.corrections.z_response`.
"""

from __future__ import annotations

import argparse
import itertools
from typing import Any

import numpy as np
from clean import draw

from mtpipe.crosschecking.prepared_bead import PreparedBead, prepare
from mtpipe.diagnosis.corrections.height_curve import SHARES, Curve, standardised
from mtpipe.diagnosis.corrections.retraced import with_positions
from mtpipe.diagnosis.corrections.softness import following_of, relaxation_s, tether_like
from mtpipe.diagnosis.corrections.z_response import curves
from mtpipe.drift import subtract_drift
from mtpipe.ground.errors import FitError
from mtpipe.ground.processes import executor
from mtpipe.ground.types import FloatArray
from mtpipe.simulation.simulate import simulate_experiment

# Frames follow each other: correlation of successive ones.
FOLLOWING = (-1.0, 0.3, 0.7, 2.0)
KINDS = ("nothing", "a curved table", "a softer tether")


def drawn_curve(random: np.random.Generator) -> Curve:
    """A table whose slope changes by 10 to 40 % over one standard deviation, evenly or in a step in
    the middle.
    """
    heights = np.linspace(-2.0, 2.0, len(SHARES))
    slope = float(random.uniform(0.1, 0.4) * random.choice([-1, 1]))
    if random.random() < 0.5:
        return Curve(heights, heights + slope / 2 * (heights**2 - 1))
    return Curve(heights, heights + 2 * abs(slope) * 0.4 * np.tanh(heights / 0.4))


def with_z(case: PreparedBead, plateau: int, z: FloatArray) -> PreparedBead:
    """The bead with z of one plateau exchanged, with the mean and the lost frames that it had."""
    positions = [position.copy() for position in case.positions_nm]
    there = positions[plateau][:, 2]
    known = np.isfinite(there)
    spread, mean = np.std(there[known]), np.mean(there[known])
    other = standardised(np.where(known, z, np.nan))
    positions[plateau][:, 2] = mean + spread * other
    return with_positions(case, tuple(positions))


def looked_at(job: tuple[int, int]) -> list[dict[str, Any]]:
    """What is seen in one configuration: of each kind one row."""
    random = np.random.default_rng(job)
    clean = draw(random, engine="linear")
    raw = simulate_experiment(clean.experiment, clean.setup, random, engine=clean.engine)
    case = prepare(subtract_drift(raw), "b1")
    plateau = int(random.integers(len(case.positions_nm)))
    z = case.positions_nm[plateau][:, 2]
    curve, camera = drawn_curve(random), clean.experiment.camera
    softer = tether_like(curve, relaxation_s(z, camera), camera, random, frames=len(z))
    changed = (z, curve.answered(standardised(z)), softer)
    rows = []
    for kind, other in zip(KINDS, changed, strict=True):
        try:
            there = case if kind == "nothing" else with_z(case, plateau, other)
        except FitError:
            continue
        seen = curves(there, random)
        mine = [one for one in seen if one.plateau == plateau]
        rows.append(
            {
                "kind": kind,
                "following": following_of(z),
                "seen": bool(mine),
                "told": any(one.told_apart for one in mine),
                "elsewhere": len(seen) - len(mine),
                "told_elsewhere": sum(one.told_apart for one in seen if one not in mine),
                "plateaus": len(case.positions_nm),
            }
        )
    return rows


def main() -> None:
    """Look and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    jobs = [(asked.seed, k) for k in range(asked.recordings)]
    with executor(asked.workers) as pool:
        found = [row for rows in pool.map(looked_at, jobs) for row in rows]
    print("| in one plateau | correlation of frames | recordings | curve seen | named as a table |")
    print("| --- | --- | --- | --- | --- |")
    for kind in KINDS:
        for low, high in itertools.pairwise(FOLLOWING):
            rows = [r for r in found if r["kind"] == kind and low <= r["following"] < high]
            seen, told = (sum(r[key] for r in rows) for key in ("seen", "told"))
            between = f"below {high:g}" if low < 0 else f"from {low:g}"
            between += f" to {high:g}" if low > 0 and high < 1 else ""
            print(f"| {kind} | {between} | {len(rows)} | {seen} | {told} |")
    others = sum(r["plateaus"] - 1 for r in found)
    seen, told = (sum(r[key] for r in found) for key in ("elsewhere", "told_elsewhere"))
    print(f"\nIn the {others} other plateaus, as they are, {seen} curves were seen, {told} named.")


if __name__ == "__main__":
    main()
