"""How often 68 % intervals of the magnet's curve hold the truth, and whether bad beads are named.

Days are those of the tests: 20 beads of 4 to 8 positions on a double exponential, 6 % from bead to
bead, two of them bad. `python workflows/magnet_curve/coverage.py --days 150`, two minutes.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from mtpipe.curves.magnet_curve.curve import magnet_curve
from mtpipe.curves.magnet_curve.measured import measured_forces
from tests.test_magnet_curve import AT, BAD, BEADS, SPREAD, table, truth


def main() -> None:
    """Print shares of intervals that hold, and of beads that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--days", type=int, default=150)
    days = parser.parse_args().days
    held, bad, sound = [], 0, 0
    for seed in range(100, 100 + days):
        curve = magnet_curve(measured_forces([("day", table(seed))]))
        middle, new = curve.curve(AT), curve.new_bead(AT)
        here = np.exp(truth(AT))
        other = here * np.exp(np.random.default_rng(1000 + seed).normal(0, SPREAD))
        spread = curve.fit.spread_low < SPREAD < curve.fit.spread_high
        of_curve = (middle.low_pN < here) & (here < middle.high_pN)
        of_new = (new.low_pN < other) & (other < new.high_pN)
        held.append([*of_curve, spread, *of_new])
        bad += int((~curve.kept[:BAD]).sum())
        sound += int((~curve.kept[BAD:]).sum())
    shares = np.mean(held, axis=0)
    print(f"{days} days; standard error of a share {np.sqrt(0.68 * 0.32 / days):.1%}")
    for where, one, another in zip(AT, shares[:3], shares[4:], strict=True):
        print(f"at {where:g} mm: curve {one:.1%}, a new bead {another:.1%}")
    print(f"spread {shares[3]:.1%}")
    print(f"bad beads named {bad} of {days * BAD}, sound ones {sound} of {days * (BEADS - BAD)}")


if __name__ == "__main__":
    main()
