"""How many nats of ln likelihood count as one, measured on clean recordings.

    python workflows/crosscheck/temperature.py --recordings 100 [--seed 1] [--workers 2]

An effect that is not there gains half its number of parameters on average, if ordinates of spectra
are independent and of the expected law (Wilks 1938). What it gains beyond that is the temperature
by which probabilities of names divide nats (`mtpipe.diagnosis.explanation.TEMPERATURE`).
"""

from __future__ import annotations

import argparse

import numpy as np
from clean import draw

from mtpipe.crosschecking.prepared_bead import prepare
from mtpipe.drift import subtract_drift
from mtpipe.effects.catalogue import OWN
from mtpipe.effects.effect import Evidence
from mtpipe.ground.processes import executor
from mtpipe.joint_fit.hypotheses import try_effects
from mtpipe.simulation.simulate import simulate_experiment

# Effects whose sizes may have either sign, so that none at all is no edge; how many sizes each has.
REGULAR = {"z_crosstalk": 2, "viscosity": 1}


def gains(job: tuple[int, int]) -> dict[str, float]:
    """What each effect gains in one clean recording (nats)."""
    random = np.random.default_rng(job)
    clean = draw(random, engine="linear")
    raw = simulate_experiment(clean.experiment, clean.setup, random, engine=clean.engine)
    fit = prepare(subtract_drift(raw), "b1").fit
    effects = [effect for effect in OWN if effect.name in REGULAR]
    evidence = Evidence((), tuple(float(force) for force in fit.force_pN))
    return {one.effect.name: one.gain for one in try_effects(fit, effects, evidence)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    told = parser.parse_args()
    with executor(told.workers) as pool:
        found = list(pool.map(gains, [(told.seed, k) for k in range(told.recordings)]))
    print("| effect | recordings | nats gained, mean | expected | temperature |")
    print("| --- | --- | --- | --- | --- |")
    for name, sizes in REGULAR.items():
        each = np.array([one[name] for one in found if name in one])
        mean, error = each.mean(), each.std(ddof=1) / np.sqrt(len(each))
        ratio = 2 / sizes
        print(
            f"| {name} | {len(each)} | {mean:.2f} ± {error:.2f} | {sizes / 2:.1f} | "
            f"{mean * ratio:.2f} ± {error * ratio:.2f} |"
        )


if __name__ == "__main__":
    main()
