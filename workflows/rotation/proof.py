"""How often each kind of tether is told right by turning it, on simulated recordings.

    python workflows/rotation/proof.py [--beads 60]

Beads of each kind, 2000 to 4000 nm long, at forces drawn evenly in their logarithm, turned 30 times
to each side. Prints a row per force range and kind: how many were named so, named otherwise, and
left open. Ends with exit code 1 if more than 5 % of those that were named were named wrongly.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from simulated import KINDS, PERSISTENCE_NM, RADIUS_NM, TEMPERATURE_K, recording

from mtpipe.curves.rotation.kinds import Known
from mtpipe.curves.rotation.turned import turned_stretches
from mtpipe.curves.rotation.verdict import CANNOT_TELL, verdict_of
from mtpipe.physics.buffer import thermal_energy_pN_nm

RANGES_PN = ((0.15, 0.6), (0.6, 2.0), (2.0, 6.0))


def main() -> None:
    """Turn beads and count."""
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("--beads", type=int, default=60, help="of each kind and range of forces")
    asked = options.parse_args()
    random = np.random.default_rng(0)
    kT = float(thermal_energy_pN_nm(TEMPERATURE_K))
    print("| force (pN) | kind | right | wrong | cannot tell |")
    print("| --- | --- | --- | --- | --- |")
    named = wrong = 0
    for low, high in RANGES_PN:
        for kind in KINDS:
            counts = dict.fromkeys(("right", "wrong", "open"), 0)
            for _ in range(asked.beads):
                force, contour = (
                    np.exp(random.uniform(np.log(low), np.log(high))),
                    random.uniform(2000, 4000),
                )
                turned = next(
                    iter(turned_stretches(recording({"b": kind}, force, contour, random)))
                )
                guess = force * random.normal(1, 0.05)
                known = Known(guess, 0.1, contour, 0.05, PERSISTENCE_NM, kT, RADIUS_NM)
                said = verdict_of(turned, known).verdict
                counts["open" if said == CANNOT_TELL else "right" if said == kind else "wrong"] += 1
            print(f"| {low} to {high} | {kind} |", *(f"{n} |" for n in counts.values()), flush=True)
            named += counts["right"] + counts["wrong"]
            wrong += counts["wrong"]
    sys.exit(int(wrong > 0.05 * named))


if __name__ == "__main__":
    main()
