"""When are few simulations enough to say that a recording agrees with them?

    python workflows/crosscheck/few_simulations.py --repeats 1 --write docs/crosscheck.md

Recordings of the study, with effects and without, are checked by 12, 24, 48 and 120 simulations,
the smaller numbers being the first of the larger. Printed is how often each would have ended the
check as consistent, by the p-value of all 120.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "common"))
import clean
import effects
import numpy as np
import pages

from mtpipe.crosschecking.check import CLEARLY_CONSISTENT, CONSISTENT_BY_FEW, ROUNDS, check_bead
from mtpipe.ground.errors import FitError
from mtpipe.ground.processes import executor

# Edges of the p-values of 120 simulations by which recordings are told apart; the second is the
# alarm's.
EDGES = (0.0, 1e-5, 0.004, 0.01, 0.05, 0.2, 1.0)


def p_values(job: tuple[str, float, int, int]) -> list[float] | None:
    """p-values of one recording by each number of simulations; None where it cannot be fitted.

    Parameters
    ----------
    job : of `effects.measure`; without a name nothing is wrong with the recording.
    """
    name, _, seed, number = job
    try:
        if name:
            random = effects.generator(job)
            case = effects.prepared(job, random)
        else:
            random = np.random.default_rng((seed, number))
            case = clean.prepared(clean.draw(random), random)
        found, begun = [], None
        for goal in ROUNDS:
            begun = check_bead(case, random, rounds=(goal,), begun=begun)
            found.append(begun.p_value)
    except (FitError, ValueError):
        return None
    return found


def table(found: np.ndarray) -> str:
    """Shares of recordings whose check would have ended as consistent, by their last p-value."""
    fewer = ROUNDS[:-1]
    levels = [CONSISTENT_BY_FEW.get(goal, CLEARLY_CONSISTENT) for goal in fewer]
    header = f"p by {ROUNDS[-1]} simulations | recordings"
    for goal, level in zip(fewer, levels, strict=True):
        header += f" | p > {level:g} by {goal}"
    lines = []
    for low, high in itertools.pairwise(EDGES):
        these = found[(found[:, -1] >= low) & (found[:, -1] < high)]
        counts = [str(int(np.sum(these[:, k] > level))) for k, level in enumerate(levels)]
        lines.append([f"{low:g} to {high:g}", str(len(these)), *counts])
    return pages.table(header, lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=1, help="per effect and strength")
    parser.add_argument("--clean", type=int, default=100, help="recordings without an effect")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--write", type=Path, help="page to put the table into")
    told = parser.parse_args()
    jobs = [
        (one.name, strength, told.seed, n)
        for n in range(told.repeats)
        for one in effects.EFFECTS
        for strength in one.strengths
    ]
    jobs += [("", 0.0, told.seed, n) for n in range(told.clean)]
    with executor(told.workers) as pool:
        found = [one for one in pool.map(p_values, jobs) if one is not None]
    command = (
        f"python workflows/crosscheck/few_simulations.py --repeats {told.repeats} "
        f"--clean {told.clean} --seed {told.seed}"
    )
    block = f"{table(np.array(found))}\n\nPrinted by `{command}`."
    print(block)
    if told.write is not None:
        page = told.write.read_text(encoding="utf-8")
        told.write.write_text(pages.into_page(page, {"few": block}), encoding="utf-8")


if __name__ == "__main__":
    main()
