"""Steps of the height of all beads together, their noise known from all beads and plateaus.

The sum over beads of one stretch tells its own noise badly: from 24 blocks, with a Student's t of
some 20 degrees of freedom. Each bead tells its own part of it as well, and what is left are the
covariances of beads: drift that is left and the references' noise move all beads by as many nm, at
every force. Var of the sum is Σ var_i + 2 Σ cov_ij, cov_ij the shared variance alike for all pairs
and all plateaus of a recording: white noise per frame, and a random walk. It is a grid of cells,
each as likely as the sums of the other plateaus and this one make it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft, special, stats

from mtpipe.recording.recording import FloatArray, Plateau
from mtpipe.states.blocks import LEAST_BLOCKS, block_width, blocks_of
from mtpipe.states.level import WALKS, normal_from_log_tail, white_eigenvalues
from mtpipe.states.motion import Motion, slowest_relaxation

# With more blocks the sum's own noise is known to 7 % and better, and nothing is to be gained.
MOST_POOLED = 100
# Shared noise from a hundredth of the quietest bead's, which no sum shows, to the loudest's.
LEAST_TOLD, GRID = 0.01, 14
# Noise that a stretch has for itself, over that of its beads, and shares of its walk.
APART = np.geomspace(0.1, 100.0, 7)
APART_WALKS = (0.0, 0.01, 0.1, 1.0, 10.0)
# Parameters of a bead's noise: its white part and its walk.
PARAMETERS = 2


@dataclass(frozen=True)
class Prior:
    """Probabilities of shared noise in a stretch, before the stretch itself is looked at.

    Attributes
    ----------
    white, walk : (cells,) variance in nm² of one frame's noise, and of the walk per frame.
    log_weight : (cells,). apart : probability that the stretch is unlike the other plateaus.
    """

    white: FloatArray
    walk: FloatArray
    log_weight: FloatArray
    apart: float


@dataclass(frozen=True)
class SharedNoise:
    """What each plateau says of the noise that beads share.

    `white` and `walk` (cells,) as in `Prior`; `spans` rows of each plateau; `log_likelihood`
    (plateaus, cells).
    """

    white: FloatArray
    walk: FloatArray
    spans: tuple[tuple[int, int], ...]
    log_likelihood: FloatArray

    def prior(self, start: int, stop: int) -> Prior | None:
        """What the plateaus outside of rows [start, stop) say; None without any."""
        outside = np.array([b <= start or a >= stop for a, b in self.spans])
        if not outside.any():
            return None
        total = self.log_likelihood[outside].sum(axis=0)
        # Laplace's rule of succession: of so many plateaus none was apart from the others
        apart = 1 / (int(outside.sum()) + 2)
        return Prior(self.white, self.walk, total - special.logsumexp(total), apart)


@dataclass(frozen=True)
class Sum:
    """Block means of all beads of a stretch, each over its noise, summed.

    Attributes
    ----------
    ordinates : (modes,) sine transform of the sum's differences.
    own : (modes,) variances of the ordinates by the beads' own noises. scale_nm : (beads,) by which each is divided.
    """

    ordinates: FloatArray
    own: FloatArray
    scale_nm: FloatArray
    width: int

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the beads' own noises."""
        return len(self.scale_nm) * max(len(self.ordinates) - 1 - PARAMETERS, 1)

    def shared(self, white: FloatArray, walk: FloatArray) -> FloatArray:
        """(cells, modes) variances that covariances of beads add."""
        pairs = float(np.sum(1 / self.scale_nm)) ** 2 - float(np.sum(self.scale_nm**-2.0))
        modes = white_eigenvalues(len(self.ordinates))
        return np.asarray(
            pairs * (white[:, None] / self.width * modes + walk[:, None] * self.width)
        )


def sum_of(levels: Sequence[FloatArray], width: int) -> Sum:
    """The sum of beads' block means, (n,) in nm each, of blocks of `width` frames."""
    ordinates, owns, scales = [], [], []
    for level in levels:
        y = fft.dst(np.diff(level), type=1, norm="ortho")
        own = _own(y)
        scale = math.sqrt(float(own.mean()))
        ordinates.append(y / scale)
        owns.append(own / scale**2)
        scales.append(scale)
    return Sum(np.sum(ordinates, axis=0), np.sum(owns, axis=0), np.array(scales), width)


def pooled_scores(total: Sum, prior: Prior) -> FloatArray:
    """(places,) steps of the sum as standard normal numbers where there is none.

    Each cell has its own error and tail; they count as likely as the other plateaus and this
    stretch make them.
    """
    modes = white_eigenvalues(len(total.ordinates))
    shapes = np.array([(share + modes) / (share + modes).mean() for share in APART_WALKS])
    apart = (APART[:, None, None] * total.own.mean() * shapes).reshape(-1, len(modes))
    cells = np.concatenate([total.shared(prior.white, prior.walk), apart])
    log_weight = np.concatenate(
        [
            prior.log_weight + math.log1p(-prior.apart),
            np.full(len(apart), math.log(prior.apart / len(apart))),
        ]
    )
    likely = log_weight > log_weight.max() - math.log(1e9)
    score, log_likelihood = _steps(total, cells[likely])
    weight = log_weight[likely][:, None] + log_likelihood
    weight -= special.logsumexp(weight, axis=0)
    tail = special.logsumexp(weight + stats.t.logsf(np.abs(score), total.freedom), axis=0)
    sign = np.sign(np.sum(np.exp(weight) * score, axis=0))
    return np.asarray(sign * normal_from_log_tail(np.minimum(tail, math.log(0.5))))


def shared_noise(motion: Motion, plateaus: Sequence[Plateau]) -> SharedNoise | None:
    """What plateaus say of the noise that beads share; None with one bead, or nothing to go by."""
    sums, spans = [], []
    for plateau in plateaus:
        start, stop = plateau.start, plateau.stop
        width = block_width(slowest_relaxation(motion, start, stop), stop - start)
        width = max(width, (stop - start) // MOST_POOLED)
        if (stop - start) // width < LEAST_BLOCKS:
            continue
        blocks = [blocks_of(xyz[start:stop], width) for xyz in motion.position_nm.values()]
        levels = [one.height_nm for one in blocks if one.height_nm is not None]
        if len(levels) > 1:
            sums.append(sum_of(levels, width))
            spans.append((start, stop))
    return noise_of_sums(sums, spans) if sums else None


def noise_of_sums(sums: Sequence[Sum], spans: Sequence[tuple[int, int]]) -> SharedNoise:
    """Likelihoods of shared noise by the sums of plateaus at rows `spans`."""
    scales = [one.scale_nm.min() ** 2 for one in sums], [one.scale_nm.max() ** 2 for one in sums]
    widths = np.array([one.width for one in sums])
    white = _grid(scales[0] * widths, scales[1] * widths)
    walk = _grid(scales[0] / widths, scales[1] / widths)
    whites, walks = (each.ravel() for each in np.meshgrid(white, walk))
    found = []
    for one in sums:
        _, log_likelihood = _steps(one, one.shared(whites, walks))
        # a step may be anywhere, and is none of the noise
        found.append(special.logsumexp(log_likelihood, axis=1) - math.log(log_likelihood.shape[1]))
    return SharedNoise(whites, walks, tuple(spans), np.array(found))


def _grid(least: FloatArray, most: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.geomspace(LEAST_TOLD * least.min(), most.max(), GRID)])


def _own(ordinates: FloatArray) -> FloatArray:
    """(modes,) variances of a bead's ordinates: of all white noises, walks and places of one step,
    each as likely as its restricted likelihood.
    """
    n = len(ordinates)
    shape = WALKS[:, None] + white_eigenvalues(n)
    numerator = (ordinates / shape) @ _sines(n)
    precision = (1 / shape) @ _sines(n) ** 2
    left = (ordinates**2 / shape).sum(axis=1)[:, None] - numerator**2 / precision
    left = np.maximum(left, 1e-300)
    log = -(n - 1) / 2 * np.log(left) - (np.log(shape).sum(axis=1)[:, None] + np.log(precision)) / 2
    weight = np.exp(log - special.logsumexp(log)) * left / (n - 1)
    return np.asarray(weight.sum(axis=1) @ shape)


def _steps(total: Sum, cells: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(cells, places) steps over their standard errors, and restricted log-likelihoods of cells."""
    y, sines = total.ordinates, _sines(len(total.ordinates))
    variance = total.own + cells
    inverse = 1 / variance
    precision = inverse @ sines**2
    score = (inverse * y) @ sines / np.sqrt(precision)
    left = (inverse @ y**2)[:, None] - score**2
    log = np.log(variance).sum(axis=1)[:, None] + np.log(precision) + left
    return score, -log / 2


@functools.lru_cache(maxsize=8)
def _sines(n: int) -> FloatArray:
    """(place, mode) eigenvectors of the differences' covariance."""
    j = np.arange(1, n + 1)
    return np.asarray(math.sqrt(2 / (n + 1)) * np.sin(np.pi * np.outer(j, j) / (n + 1)))
