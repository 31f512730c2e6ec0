"""The lag of the beads behind the magnets' log: one, one that grows with time, or an edge's own."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from mtpipe.ground.types import FloatArray
from mtpipe.states.coarse import likely_shift
from mtpipe.states.edges import Edge, EdgeLag, edge_lag
from mtpipe.states.motion import Motion

# Gain in ln likelihood (nats) from which a shift of the whole log is considered; chance gives a
# tenth of it.
SHIFT_NATS = 20.0
# Standard errors from which a lag is certain: chance reaches them in one of 16 000 recordings.
SIGMAS = 4.0
# Nats by which an edge has to contradict the common lag to have its own.
OWN_NATS = 12.0
# An edge is looked for within this time of where the whole log puts it.
WIDEST_S = 30.0
# Edges from which a lag that grows with time (another clock) is fitted.
FEWEST_FOR_CLOCK = 5
# Edges with errors of more than this many times the median do not count for a common lag.
EXACT = 3.0


@dataclass(frozen=True)
class Lag:
    """What beads say of the log, in rows; positive: beads change after the log does.

    Attributes
    ----------
    edges : of each edge that could be looked at.
    shift : (edges of the log,) by which each edge is late; 0 where the log is right.
    error : (edges of the log,) of it.
    own : numbers of the edges whose lag is their own.
    common, common_error : the lag that edges share; of a log with another clock at its middle.
    per_row : by which it grows per row, 0 but for a log with another clock.
    """

    edges: tuple[EdgeLag, ...]
    shift: FloatArray
    error: FloatArray
    own: tuple[int, ...]
    common: float
    common_error: float
    per_row: float

    @property
    def wrong(self) -> bool:
        """Whether any edge is elsewhere than the log says."""
        return bool(np.any(self.shift != 0))


def find_lag(motion: Motion, edges: Sequence[Edge]) -> Lag | None:
    """Hold the log against the beads; None where no edge shows a change."""
    if not edges:
        return None
    shift, nats = likely_shift(motion, edges)
    found = _edge_lags(motion, edges, np.zeros(len(edges)))
    if shift and nats > SHIFT_NATS:
        moved = _edge_lags(motion, edges, np.full(len(edges), float(shift)))
        # edges that a shift puts beyond the recording cannot be seen
        enough = 2 * len(moved) >= len(edges) and _share_seen(moved) >= _share_seen(found)
        if enough and _likelier(moved, found):
            found = moved
    seen = [one for one in found if one.seen]
    if not seen:
        return None
    errors = np.array([one.error for one in seen])
    # slow moves tell little of when, and scatter for other reasons
    exact = [one for one in seen if one.error <= EXACT * float(np.median(errors))]
    lags = np.array([one.best for one in exact])
    errors = np.array([one.error for one in exact])
    rows = np.array([0.5 * (one.edge.stop + one.edge.start) for one in exact])
    per_row, middle = _clock(rows, lags, errors), float(rows.mean())
    straight = lags - per_row * (rows - middle)
    common, common_error = _common(straight, errors)
    where = np.array([0.5 * (edge.stop + edge.start) for edge in edges])
    expected = common + per_row * (where - middle)
    dwell = _shortest_dwell(edges, len(motion.time_s))
    grows = per_row != 0 and common_error < dwell
    certain = grows or _beyond(common, common_error, exact, dwell)
    shifts = expected if certain else np.zeros(len(edges))
    error = np.full(len(edges), common_error)
    own = []
    for one in seen:
        i = edges.index(one.edge)
        allowed = SIGMAS * math.hypot(one.error, common_error if certain else 0.0) + 1
        if (
            abs(one.best - shifts[i]) > allowed
            and one.error < dwell
            and one.nats_lost_at(shifts[i]) > OWN_NATS
            and not _also_at(motion, one, float(shifts[i]), allowed)
        ):
            own.append(one.edge.number)
            shifts[i], error[i] = one.best, one.error
    return Lag(tuple(found), shifts, error, tuple(own), common, common_error, per_row)


def _share_seen(lags: Sequence[EdgeLag]) -> float:
    return sum(one.seen for one in lags) / len(lags) if lags else 0.0


def _likelier(moved: Sequence[EdgeLag], found: Sequence[EdgeLag]) -> bool:
    """Whether the edges that both searches could look at are the plainer where the log is moved to.

    The shift of the whole log takes each move for one state, and long moves are none: it only says
    where to look.
    """
    there, here = ({one.edge.number: one.nats for one in lags} for lags in (moved, found))
    both = there.keys() & here.keys()
    return sum(there[number] for number in both) > sum(here[number] for number in both)


def _edge_lags(motion: Motion, edges: Sequence[Edge], shift: FloatArray) -> list[EdgeLag]:
    rows, widest = len(motion.time_s), WIDEST_S / motion.frame_s
    middles = [(a.start + b.stop) / 2 for a, b in itertools.pairwise(edges)]
    found = []
    for i, edge in enumerate(edges):
        begin = middles[i - 1] + shift[i] if i else 0.0
        end = middles[i] + shift[i] if i < len(middles) else float(rows)
        begin, end = (
            max(begin, edge.stop + shift[i] - widest),
            min(end, edge.start + shift[i] + widest),
        )
        inside = np.clip([begin, end], 0, rows).astype(int)
        one = edge_lag(motion, edge, int(inside[0]), int(inside[1]), round(float(shift[i])))
        if one is not None:
            found.append(one)
    return found


def _also_at(motion: Motion, one: EdgeLag, shift: float, allowed: float) -> bool:
    """Whether beads change where the edge is expected too: then the other change is none of its.

    Only what is nearer to the edge than to the other change is looked at.
    """
    begin, end = one.begin, one.end
    halfway = (one.best + shift) / 2
    if one.best < shift:
        begin = max(begin, math.ceil(one.edge.start + halfway))
    else:
        end = min(end, math.floor(one.edge.stop + halfway))
    there = edge_lag(motion, one.edge, begin, end, round(shift))
    return there is not None and there.seen and abs(there.best - shift) <= allowed


def _shortest_dwell(edges: Sequence[Edge], rows: int) -> int:
    """Rows of the shortest dwell by the log."""
    starts = [0, *(edge.start for edge in edges)]
    stops = [*(edge.stop for edge in edges), rows]
    return min(stop - start for start, stop in zip(starts, stops, strict=True))


def _beyond(common: float, error: float, seen: Sequence[EdgeLag], dwell: int) -> bool:
    """Whether the common lag is one, and not how beads and motors follow.

    One that is less certain than the shortest dwell is long does not tell which dwell is which.
    """
    allowed = float(np.median([one.systematic for one in seen])) + 1.0
    return error < dwell and abs(common) > SIGMAS * error + allowed


def _clock(rows: FloatArray, lags: FloatArray, errors: FloatArray) -> float:
    """Lag per row of a log with another clock; 0 where it is not certain.

    Theil and Sen's slope: edges with a lag of their own do not count.
    """
    if len(rows) < FEWEST_FOR_CLOCK:
        return 0.0
    slope = float(stats.theilslopes(lags, rows)[0])
    left = lags - slope * rows
    scatter = stats.median_abs_deviation(left, scale="normal")
    spread = math.hypot(float(scatter), float(np.median(errors)))
    error = 1.25 * spread / math.sqrt(float(np.sum((rows - rows.mean()) ** 2)))
    # a clock's lag grows by far more than lags scatter
    grown = abs(slope) * float(np.ptp(rows))
    return slope if abs(slope) > SIGMAS * error and grown > SIGMAS * spread else 0.0


def _common(lags: FloatArray, errors: FloatArray) -> tuple[float, float]:
    """Weighted median of lags and its standard error.

    What edges scatter beyond their errors is in the weights, so that none of them speaks alone.
    Edges count and not beads, which share the motor (PHYSICS 8.8: 1.25 times the error of a mean).
    """
    scatter = float(stats.median_abs_deviation(lags, scale="normal"))
    beyond = max(scatter**2 - float(np.median(errors**2)), 0.0)
    weights = 1 / (errors**2 + beyond)
    return _weighted_median(lags, weights), 1.25 * float(weights.sum() ** -0.5)


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    order = np.argsort(values)
    passed = np.cumsum(weights[order]) / weights.sum()
    # interpolated between midpoints of the weights, so that two values give their mean
    middle = passed - weights[order] / weights.sum() / 2
    return float(np.interp(0.5, middle, values[order]))
