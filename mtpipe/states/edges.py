"""When beads change at each move of the magnets that the log shows.

Between two dwells the mean and the variance of x, y and z of all beads go from one state to the
other, as the magnets of the log do, but for a lag. Each lag has a likelihood: of all frames about
the edge, each counted as far as it is independent of its neighbours (PHYSICS 8.8, E29).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import Plateau
from mtpipe.states.motion import Motion, independent_share, slowest_relaxation

State = tuple[float, float]
# Nats by which a change has to be more likely than none for an edge to be seen at all: with two
# levels and variances more for each of three axes chance reaches it once in ten thousand edges.
SEEN_NATS = 16.0
LEAST_FRAMES = 16
# Error of a move's middle, as a share of its length: the force's course is taken from the log's
# positions, and motors and magnets differ from that. What the chain's formula shifts comes on top.
SHAPE_SHARE = 0.02


@dataclass(frozen=True)
class Edge:
    """A move between two plateaus.

    `stop` and `start` : rows at which the plateau before ends and that after begins by the log.
    `progress` (start − stop,) : share of the move that is done, by the log.
    """

    number: int
    stop: int
    start: int
    progress: FloatArray

    @property
    def moving(self) -> int:
        """Rows of the move itself, without what is left for settling."""
        return int(np.count_nonzero(self.progress < 1))


@dataclass(frozen=True)
class EdgeLag:
    """Lag of the beads behind the log at one edge.

    Attributes
    ----------
    begin, end : rows that were looked at.
    lag_rows : (n,) lags that were tried. log_likelihood : (n,) of each.
    nats : by which the best is more likely than no change at all.
    relaxation_rows : within which beads follow the force.
    force_ratio : force after over force before, roughly.
    """

    edge: Edge
    begin: int
    end: int
    lag_rows: FloatArray
    log_likelihood: FloatArray
    nats: float
    relaxation_rows: float
    force_ratio: float

    @property
    def systematic(self) -> float:
        """Rows by which the best may be off beside chance."""
        shape = SHAPE_SHARE + abs(0.5 - _middle_of_course(self.force_ratio))
        return math.hypot(shape * self.edge.moving, self.relaxation_rows)

    @property
    def error(self) -> float:
        """Error of the best in rows, chance and the rest."""
        return math.hypot(self.stderr, self.systematic)

    @property
    def seen(self) -> bool:
        """Whether the beads show a change at all."""
        return self.nats > SEEN_NATS

    @property
    def probability(self) -> FloatArray:
        """(n,) of each lag, all lags having the same prior probability."""
        weight = np.exp(self.log_likelihood - self.log_likelihood.max())
        return np.asarray(weight / weight.sum())

    @property
    def best(self) -> float:
        """Most likely lag, in rows."""
        return float(self.lag_rows[int(np.argmax(self.log_likelihood))])

    @property
    def stderr(self) -> float:
        """Standard deviation of the lag, in rows; no less than that of one row."""
        p = self.probability
        mean = float(p @ self.lag_rows)
        return math.hypot(math.sqrt(float(p @ (self.lag_rows - mean) ** 2)), 1 / math.sqrt(12))

    def nats_lost_at(self, lag_rows: float) -> float:
        """By how much a lag is less likely than the best."""
        there = np.interp(lag_rows, self.lag_rows, self.log_likelihood)
        return float(self.log_likelihood.max() - there)


def edges_of(plateaus: Sequence[Plateau], magnet_mm: FloatArray | None) -> list[Edge]:
    """The moves between successive plateaus."""
    found = []
    for before, after in itertools.pairwise(plateaus):
        rows = np.arange(before.stop, after.start)
        progress = (rows - before.stop + 1.0) / (len(rows) + 1)
        if magnet_mm is not None and before.magnet_mm is not None and after.magnet_mm is not None:
            whole = after.magnet_mm - before.magnet_mm
            moved = magnet_mm[rows] - before.magnet_mm
            known = np.isfinite(moved)
            if whole != 0 and known.any():
                progress = np.interp(rows, rows[known], np.clip(moved[known] / whole, 0, 1))
        found.append(Edge(before.number, before.stop, after.start, progress))
    return found


def edge_lag(motion: Motion, edge: Edge, begin: int, end: int, at: int) -> EdgeLag | None:
    """Likelihood of the lags at one edge.

    Parameters
    ----------
    begin, end : rows of the middle of the dwells before and after, where their states are pure.
    at : lag in rows about which the edge is looked for.

    Returns
    -------
    None where the dwells are too short, or no position is known there.
    """
    sides = sides_of(motion, begin, end, edge.stop + at, edge.start + at)
    if sides is None:
        return None
    lags = np.arange(begin - edge.stop + 1, end - edge.start)
    if len(lags) < 2:
        return None
    total = sides.log_likelihood(edge.progress, lags + edge.stop - begin)
    nats = float(total.max()) - sides.unchanged
    return EdgeLag(
        edge, begin, end, lags.astype(float), total, nats, sides.relaxation_rows, sides.force_ratio
    )


@dataclass(frozen=True)
class Sides:
    """Two states and the frames between and about them.

    Attributes
    ----------
    columns : (n,) each, one coordinate of a bead. axis : of each, 0 to 2. share : of each, its
        independent values per frame. before, after : of each, mean and variance.
    force_ratio : force after over force before, roughly.
    unchanged : log-likelihood of one state throughout.
    """

    columns: tuple[FloatArray, ...]
    axis: tuple[int, ...]
    share: tuple[float, ...]
    before: tuple[State, ...]
    after: tuple[State, ...]
    force_ratio: float
    unchanged: float
    relaxation_rows: float

    def log_likelihood(self, progress: FloatArray, change: NDArray[np.int64]) -> FloatArray:
        """Log-likelihood of a change along a course that begins at each of some rows."""
        height = _height_course(progress, self.force_ratio)
        total = np.zeros(len(change))
        for column, axis, share, before, after in zip(
            self.columns, self.axis, self.share, self.before, self.after, strict=True
        ):
            course = height if axis == 2 else progress
            total -= 0.5 * share * _cost(column, before, after, course, change)
        return total


def sides_of(motion: Motion, begin: int, end: int, stop: int, start: int) -> Sides | None:
    """The states on both sides of a change in rows [begin, end) that is about [stop, start).

    Their outer halves tell the states, as the inner ones may belong to the other side.
    """
    first = slice(begin, begin + max((stop - begin) // 2, 0))
    last = slice(end - max((end - start) // 2, 0), end)
    if min(first.stop - first.start, last.stop - last.start) < LEAST_FRAMES:
        return None
    kept: list[tuple[FloatArray, int, float, State, State]] = []
    focus = float(motion.focus_nm[begin:end].max())
    unchanged = 0.0
    for xyz in motion.position_nm.values():
        for axis in range(3):
            outer = (xyz[first, axis], xyz[last, axis])
            share = min(independent_share(column) for column in outer)
            if share == 0:
                continue
            before, after = ((float(np.nanmean(c)), float(np.nanvar(c))) for c in outer)
            if min(before[1], after[1]) <= 0:
                continue
            if axis == 2 and abs(after[0] - before[0]) < focus:
                continue
            column = xyz[begin:end, axis]
            known = column[np.isfinite(column)]
            unchanged -= 0.5 * share * len(known) * (1 + math.log(float(known.var())))
            kept.append((column, axis, share, before, after))
    if not kept:
        return None
    slow = max(slowest_relaxation(motion, rows.start, rows.stop) for rows in (first, last))
    columns, axes, shares, befores, afters = zip(*kept, strict=True)
    ratio = _force_ratio(motion, first, last)
    return Sides(columns, axes, shares, befores, afters, ratio, unchanged, slow)


def _cost(
    column: FloatArray,
    before: State,
    after: State,
    course: FloatArray,
    change: NDArray[np.int64],
) -> FloatArray:
    """Minus twice the log-likelihood of a column (n,) for each row at which the change begins."""
    known = np.isfinite(column)
    value = np.where(known, column - before[0], 0.0)
    there = known.astype(float)

    def from_start(state: State) -> FloatArray:
        mean, variance = state[0] - before[0], state[1]
        each = there * ((value - mean) ** 2 / variance + math.log(variance))
        return np.concatenate([[0.0], np.cumsum(each)])

    first, last = from_start(before), from_start(after)
    moved = len(course)
    cost = first[change] + last[-1] - last[change + moved]
    if moved:
        mean = (after[0] - before[0]) * course
        log_variance = (1 - course) * math.log(before[1]) + course * math.log(after[1])
        weight = np.exp(-log_variance)
        sums = (
            _correlated(value**2, weight)
            - 2 * _correlated(value, weight * mean)
            + _correlated(there, weight * mean**2 + log_variance)
        )
        cost = cost + sums[change]
    return np.asarray(cost)


def _correlated(values: FloatArray, template: FloatArray) -> FloatArray:
    """Σ_j values[i + j] template[j] for each i at which the template fits."""
    return np.asarray(signal.correlate(values, template, mode="valid"))


def _force_ratio(motion: Motion, first: slice, last: slice) -> float:
    """Force after over force before, roughly: the median of what sideways motion says."""
    logs = []
    for xyz in motion.position_nm.values():
        if not (_two_known(xyz[first, :2]) and _two_known(xyz[last, :2])):
            continue  # x and y were not recorded
        before, after = (np.nanvar(xyz[rows, :2], axis=0) for rows in (first, last))
        sound = (before > 0) & (after > 0)
        logs += list(np.log(before[sound] / after[sound]))
    return math.exp(float(np.clip(np.median(logs), -5, 5))) if logs else 1.0


def _two_known(columns: FloatArray) -> bool:
    return bool((np.isfinite(columns).sum(axis=0) >= 2).all())


def _height_course(progress: FloatArray, ratio: float) -> FloatArray:
    """Share of the way that the height has gone, as ln F goes steadily with the magnets.

    A stretched chain is shorter than its contour by a length ∝ 1/√F (Marko & Siggia 1995, eq. 7
    for strong forces).
    """
    if abs(math.log(ratio)) < 1e-3:
        return progress
    return np.asarray((1 - ratio ** (-progress / 2)) / (1 - ratio**-0.5))


def _middle_of_course(ratio: float) -> float:
    """Share of a move after which the height has gone half its way."""
    log = math.log(ratio)
    return 0.5 if abs(log) < 1e-3 else 2 / log * math.log(2 / (1 + math.exp(-log / 2)))
