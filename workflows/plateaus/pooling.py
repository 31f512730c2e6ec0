"""Whether pooling the noise of all beads and plateaus finds hidden steps that the sum alone misses.

    python workflows/plateaus/pooling.py

The height of all beads together has a step; the noise of that sum is estimated from its own 24
blocks (`mtpipe.states.change`), or pooled: Var = Σ var_i + 2 Σ cov_ij. Each bead tells its own
white noise and walk by restricted likelihood; shares of the walk are pooled over beads, but for the
chance that a bead differs. What beads share is alike in nm for all pairs and plateaus ("alike"), or
also, by Laplace's rule of succession, the stretch's own ("apart"). Each cell of the grid has
Student's tail with the degrees of freedom of all beads. Prints how often chance makes steps, and
how often real ones are found; docs/plateaus.md has what follows. With `--tails N`, of N recordings,
only how the sum does if the probability is the mean of those under each noise, and not that of the
mean variance.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from scipy import fft, special, stats

from mtpipe.recording.recording import FloatArray
from mtpipe.states.level import (
    WALKS,
    _likely_noises,
    _normal_from_log_tail,
    _without_step,
    step_scores,
)
from mtpipe.states.level import _steps as _steps_of

BLOCKS, PLATEAUS = 24, 8
MODES = BLOCKS - 1
J = np.arange(1, MODES + 1)
EIGEN = 2 - 2 * np.cos(np.pi * J / BLOCKS)
SINES = math.sqrt(2 / BLOCKS) * np.sin(np.pi * np.outer(J, J) / BLOCKS)
SHAPES = WALKS[:, None] + EIGEN
# Shared noise between a hundredth of the quietest bead's variance and the loudest's.
LEAST_TOLD, GRID = 0.01, 8
# Shared noise that is a stretch's own, over its beads' noise, and shares of its walk.
APART = np.geomspace(0.1, 100.0, 7)
APART_SHAPES = np.array([(w + EIGEN) / (w + EIGEN).mean() for w in (0.0, 0.01, 0.1, 1.0, 10.0)])
# By the code a recording of 8 plateaus is cut by chance once in 1000: ln p of 1e-3 / 8, all places
# and the beads by themselves tried, two quantities.
CHANCE_PER_RECORDING = 1e-3
CHUNK = 20
PLACE = BLOCKS // 2 - 1
NEAR = slice(PLACE - 2, PLACE + 3)
# Standard error of a step in the middle of white noise of 1 per block.
UNIT = math.sqrt(4 / BLOCKS)
# Shared noise of the null recordings in nm: white, walk per block, and a walk of the first plateau
# alone.
NULLS = {
    "none": (0.0, 0.0, 0.0),
    "white": (10.0, 0.0, 0.0),
    "walk": (0.0, 3.0, 0.0),
    "white and walk": (10.0, 3.0, 0.0),
    "walk of one plateau": (0.0, 0.0, 10.0),
}


def main() -> None:
    """Print false and found steps."""
    parser = argparse.ArgumentParser(description="Steps of the sum over beads, noise pooled.")
    parser.add_argument("--nulls", type=int, default=2500, help="recordings of 8 plateaus")
    parser.add_argument("--old", type=int, default=125, help="of them, by the sum alone")
    parser.add_argument("--steps", type=int, default=100, help="per number of beads and size")
    parser.add_argument("--noise", choices=NULLS, nargs="*", default=list(NULLS))
    parser.add_argument("--tails", type=int, help="recordings for the sum's probability alone")
    choice = parser.parse_args()
    if choice.tails:
        print("\n".join(_tails(choice.tails)))
        return
    for beads in (2, 3, 5, 10) if choice.steps else ():
        for size in (2.0, 3.0, 4.0):
            print(_found(np.random.default_rng([beads, 3]), beads, size, choice.steps), flush=True)
    for name in choice.noise:
        for line in _false(np.random.default_rng(4), name, 5, choice.nulls, choice.old):
            print(line, flush=True)


def _found(random: np.random.Generator, beads: int, size: float, count: int) -> str:
    """Share of steps found in the first plateau, by each of the three."""
    limit = _limit(beads)
    hits: list[list[float]] = []
    for _ in range(0, count, CHUNK):
        levels = _drawn(random, CHUNK, beads, (0.0, 0.0, 0.0), size)
        old = [_by_sum(one[0]) for one in levels]
        alike, apart = pooled(levels, 1)
        hits += [
            [float(np.abs(one[NEAR]).max()) for one in each]
            for each in zip(old, alike[:, 0], apart[:, 0], strict=True)
        ]
    share, middle = np.mean(np.array(hits) > limit, axis=0), np.median(hits, axis=0)
    return (
        f"{beads} beads, {size:g} sigma each: found by the sum {share[0]:.2f}, pooled (alike) "
        f"{share[1]:.2f}, pooled (apart) {share[2]:.2f}; median scores {middle[0]:.1f} "
        f"{middle[1]:.1f} {middle[2]:.1f}, needed {limit:.1f}"
    )


def _false(random: np.random.Generator, name: str, beads: int, count: int, few: int) -> list[str]:
    """How often chance makes steps of some probabilities, all places of a stretch tried."""
    scores: dict[str, list[FloatArray]] = {"sum": [], "alike": [], "apart": []}
    only = 1 if name == "walk of one plateau" else PLATEAUS
    for begun in range(0, count, CHUNK):
        levels = _drawn(random, CHUNK, beads, NULLS[name], 0.0)
        for key, found in zip(("alike", "apart"), pooled(levels, only), strict=True):
            scores[key] += list(found.reshape(-1, MODES))
        if begun < few:
            scores["sum"] += [_by_sum(p) for one in levels for p in one[:only]]
    lines = []
    for key, each in scores.items():
        p = 2 * MODES * stats.norm.sf(np.abs(each).max(axis=1))
        counts = ", ".join(f"{np.sum(p < a)} of {a * len(p):g}" for a in (1e-1, 1e-2, 1e-3, 1e-4))
        lines.append(f"shared noise {name}, {key}, {len(p)} stretches: false {counts} allowed")
    return lines


def _tails(count: int) -> list[str]:
    """How often chance makes steps, and 5 beads' own are found, by the sum's two probabilities."""
    lines = []
    for name in ("none", "walk"):
        levels = _drawn(np.random.default_rng(4), count, 5, NULLS[name], 0.0)
        scores = np.array([_by_two_tails(one) for one in levels.reshape(-1, 5, BLOCKS)])
        p = 2 * MODES * stats.norm.sf(np.abs(scores).max(axis=-1))
        for key, each in zip(("mean variance", "each noise"), p.T, strict=True):
            false = ", ".join(f"{np.sum(each < a)} of {a * len(p):g}" for a in (1e-1, 1e-2, 1e-3))
            lines.append(f"shared noise {name}, {key}: false {false} allowed")
    for size in (2.0, 3.0, 4.0):
        levels = _drawn(np.random.default_rng(9), count // 4, 5, NULLS["none"], size)[:, 0]
        found = np.array([_by_two_tails(one) for one in levels])[..., NEAR].max(axis=-1)
        share = np.mean(found > _limit(5), axis=0)
        lines.append(
            f"{size:g} sigma each: mean variance {share[0]:.2f}, each noise {share[1]:.2f}"
        )
    return lines


def _limit(beads: int) -> float:
    """Score of a height that the code believes, if the sideways motion shows nothing."""
    tried = MODES * (beads + 1)
    return math.sqrt(-2 * math.log(CHANCE_PER_RECORDING / PLATEAUS / tried))


def _drawn(
    random: np.random.Generator,
    count: int,
    beads: int,
    shared_nm: tuple[float, float, float],
    size: float,
) -> FloatArray:
    """(recordings, plateaus, beads, blocks) heights in nm, with a step in the first plateaus."""
    scale = 10 ** random.uniform(0.5, 2.5, (count, PLATEAUS, 1, 1))
    scale = scale * np.exp(0.3 * random.normal(size=(count, PLATEAUS, beads, 1)))
    own = random.normal(size=(count, PLATEAUS, beads, BLOCKS))
    own[:, 0] += size * UNIT * (np.arange(BLOCKS) > PLACE)
    white, walk, alone = shared_nm
    shared = white * random.normal(size=(count, PLATEAUS, 1, BLOCKS))
    steps = random.normal(size=(count, PLATEAUS, 1, BLOCKS))
    steps *= np.where(np.arange(PLATEAUS) == 0, math.hypot(walk, alone), walk)[:, None, None]
    return np.asarray(scale * own + shared + np.cumsum(steps, axis=-1))


def _by_sum(levels: FloatArray) -> FloatArray:
    """(places,) scores of the sum by its own blocks, as in `mtpipe.states.change`."""
    return step_scores(_sum(levels)).score


def _sum(levels: FloatArray) -> FloatArray:
    noises = [step_scores(level).noise for level in levels]
    scale = [math.sqrt(noise.white * (2 + noise.walk_share)) for noise in noises]
    return np.asarray(np.sum(levels / np.array(scale)[:, None], axis=0))


def _by_two_tails(levels: FloatArray) -> FloatArray:
    """(2, places) absolute scores of the sum: by mean size and variance of all noises, as in the
    code, and by the mean of the probabilities under each.
    """
    total = _sum(levels)
    noises, weights = _likely_noises(_without_step(np.diff(total)))
    steps = [_steps_of(np.diff(total), noise) for noise in noises]
    tails = [stats.t.logsf(np.abs(size / stderr), MODES - 4) for size, stderr in steps]
    mean = special.logsumexp(np.log(weights)[:, None] + np.array(tails), axis=0)
    each = _normal_from_log_tail(mean)
    return np.stack([np.abs(step_scores(total).score), each])


def pooled(levels: FloatArray, tested: int) -> tuple[FloatArray, FloatArray]:
    """(recordings, tested, places) pooled scores of the first plateaus, alike and apart."""
    beads = levels.shape[2]
    y = fft.dst(np.diff(levels, axis=-1), type=1, norm="ortho")
    own = _own(y)
    scale = np.sqrt(own.mean(axis=-1, keepdims=True))
    total, variance = np.sum(y / scale, axis=2), np.sum(own / scale**2, axis=2)
    pairs = np.sum(1 / scale, axis=(2, 3)) ** 2 - np.sum(scale**-2.0, axis=(2, 3))
    squares = scale.reshape(len(levels), -1) ** 2
    low, high = LEAST_TOLD * squares.min(axis=1), squares.max(axis=1)
    steps = np.exp(np.linspace(np.log(low), np.log(high), GRID, axis=-1))
    grid = np.concatenate([np.zeros((len(levels), 1)), steps], axis=-1)
    shared = (grid[:, :, None, None] * EIGEN + grid[:, None, :, None]).reshape(
        len(levels), 1, -1, MODES
    )
    cells = pairs[:, :, None, None] * shared
    score, log = _steps(total, variance, cells)
    # a step may be anywhere, and is none of the noise
    said = special.logsumexp(log, axis=-1)
    others = said.sum(axis=1, keepdims=True) - said
    others = (others - special.logsumexp(others, axis=-1, keepdims=True))[:, :tested, :, None]
    score, log = score[:, :tested], log[:, :tested]
    freedom = beads * (MODES - 3)
    alike = _mixed(score, others + log, freedom)
    mean = variance[:, :tested].mean(axis=-1)[..., None, None]
    own_cells = mean * (APART[:, None, None] * APART_SHAPES).reshape(-1, MODES)
    found, own_log = _steps(total[:, :tested], variance[:, :tested], own_cells)
    chance = 1 / (PLATEAUS + 1)
    weights = [
        others + log + math.log1p(-chance),
        own_log + math.log(chance / own_cells.shape[-2]),
    ]
    apart = _mixed(np.concatenate([score, found], axis=2), np.concatenate(weights, axis=2), freedom)
    return alike, apart


def _mixed(score: FloatArray, log_weight: FloatArray, freedom: int) -> FloatArray:
    """(..., places) absolute scores of all cells, each as likely as its weight (axis −2)."""
    weight = log_weight - special.logsumexp(log_weight, axis=-2, keepdims=True)
    weight = np.where(weight > -30, weight, -np.inf)
    tail = np.sum(np.exp(weight) * special.stdtr(freedom, -np.abs(score)), axis=-2)
    return np.asarray(stats.norm.isf(np.maximum(tail, 1e-300)))


def _own(y: FloatArray) -> FloatArray:
    """(..., beads, modes) variances of beads' ordinates: all white noises, walks and places of one
    step, each as likely as the bead makes it and as the others make its share of the walk.
    """
    beads = y.shape[-2]
    scaled = y[..., None, :] / SHAPES
    precision = (1 / SHAPES) @ SINES**2
    left = np.sum(scaled * y[..., None, :], axis=-1)[..., None] - (scaled @ SINES) ** 2 / precision
    log = (
        -(MODES - 1) / 2 * np.log(left)
        - (np.log(SHAPES).sum(axis=1)[:, None] + np.log(precision)) / 2
    )
    each = special.logsumexp(log, axis=-1)
    each = each - special.logsumexp(each, axis=-1, keepdims=True)
    others = each.sum(axis=-2, keepdims=True) - each
    others = np.exp(others - special.logsumexp(others, axis=-1, keepdims=True))
    differs = 1 / (beads + 1)
    prior = np.log((1 - differs) * others + differs / len(WALKS))
    log = log + prior[..., None]
    weight = np.exp(log - special.logsumexp(log, axis=(-2, -1), keepdims=True))
    return np.asarray((weight * left / (MODES - 1)).sum(axis=-1) @ SHAPES)


def _steps(total: FloatArray, own: FloatArray, cells: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(..., cells, places) steps over standard errors, and cells' restricted log-likelihoods."""
    variance = own[..., None, :] + cells
    inverse, y = 1 / variance, total[..., None, :]
    precision = inverse @ SINES**2
    score = (inverse * y) @ SINES / np.sqrt(precision)
    left = np.sum(inverse * y**2, axis=-1)[..., None] - score**2
    logs = np.log(variance).sum(axis=-1)[..., None] + np.log(precision) + left
    return score, -logs / 2


if __name__ == "__main__":
    main()
