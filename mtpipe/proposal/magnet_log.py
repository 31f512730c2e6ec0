"""The magnets' log in a file of its own, and how its clock stands to the recording's.

The log's columns are told by name, else by value. Two clocks that begin apart are brought together
by the beads: their heights follow the magnets, so the offset is taken at which the magnets'
position explains most of the heights.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.types import FloatArray
from mtpipe.proposal.look import Column, Look
from mtpipe.proposal.name_words import said_by
from mtpipe.proposal.nature import nature_of

BIN_S = 0.25
LEVELS = 12
# A log covers the recording but for moves at its ends.
COVERED_SHARE = 0.6
# Finest step of the clock's offset (s). A found offset is taken if it explains 30 % of the heights'
# variance and, where the plain one fits in time, 5 % more than the plain one. Another that explains
# as much but for 2 % is told, if the offsets between them explain 5 % less.
FINEST_S = 0.05
WORTH_SHARE = 0.05
ALIKE_SHARE = 0.02
EXPLAINS = 0.3

NO_MAGNETS = (
    "No positions of the magnets were found: the whole recording is taken for one plateau. If you "
    "have a log of them, give it too: mtpipe init RECORDING LOG --overwrite"
)


@dataclass(frozen=True, eq=False)
class Log:
    """The log's columns; `rotation` None without any, `time` where rows are those of frames."""

    look: Look
    time: Column | None
    magnet: Column
    rotation: Column | None


@dataclass(frozen=True)
class Offset:
    """What is to be added to the log's time, s, and what share of the heights it then explains.

    `rival` is another that explains as much, None without any.
    """

    seconds: float
    explains: float
    plain: bool
    rival: float | None = None


def find_log(
    looks: Sequence[Look], rows: int, name: str, recording: Look | None = None
) -> Log | None:
    """The magnets' log among files beside a recording, or in it; None where there is none.

    Parameters
    ----------
    rows, name : of the recording.
    """
    found: list[Log] = []
    for look in looks:
        for group in look.groups:
            log = _log_of(look, group, rows)
            if log is not None:
                found.append(log)
                break
    for group in recording.groups[1:] if recording is not None else ():
        assert recording is not None
        log = _log_of(recording, group, -1)
        if log is not None and log.time is not None:
            found.append(log)
    named = [log for log in found if said_by(log.magnet.name).role == "magnet"]
    return max(named or found, key=lambda log: _alike(log.look.path.name, name), default=None)


def _alike(name: str, other: str) -> int:
    """How many signs two names begin with alike."""
    return sum(
        1
        for _ in itertools.takewhile(
            lambda pair: pair[0] == pair[1], zip(name, other, strict=False)
        )
    )


def _log_of(look: Look, group: Sequence[Column], rows: int) -> Log | None:
    said = {id(c): said_by(c.name).role for c in group}
    natures = {id(c): nature_of(c.seconds) for c in group}

    def role(wanted: str) -> Column | None:
        return next((c for c in group if said[id(c)] == wanted and natures[id(c)] != "dead"), None)

    time, magnet, rotation = role("time"), role("magnet"), role("rotation")
    clocks = [c for c in group if natures[id(c)] in ("clock", "count")]
    if time is None and clocks:
        # frames are counted before they are timed
        time = next((c for c in clocks if natures[id(c)] == "clock"), None)
    others = [
        c for c in group if said[id(c)] is None and natures[id(c)] in ("motor", "motion", "clock")
    ]
    others = [c for c in others if c is not time]
    if magnet is None and others and len(group) <= 6:
        magnet = others.pop(0)
        if rotation is None and others:
            rotation = others.pop(0)
    if magnet is None or (time is None and len(magnet.values) != rows):
        return None
    return Log(look, time, magnet, rotation)


def clock_offset(
    log_s: FloatArray,
    magnet: FloatArray,
    time_s: FloatArray,
    heights_nm: Sequence[FloatArray],
    *,
    related: bool = True,
) -> Offset:
    """Seconds to add to the log's clock.

    Parameters
    ----------
    log_s, magnet : (n_log,) the log's own time and positions.
    time_s : (n_frames,); heights_nm : z of beads, (n_frames,) each, NaN where lost.
    related : False where the two cannot be one clock, as a time of day and seconds since the start.
    """
    known = np.isfinite(log_s) & np.isfinite(magnet)
    log_s, magnet = log_s[known], magnet[known]
    lasts, logged = time_s[-1] - time_s[0], log_s[-1] - log_s[0]
    overlap = min(time_s[-1], log_s[-1]) - max(time_s[0], log_s[0])
    fits = related and overlap > COVERED_SHARE * min(lasts, logged)
    plain = 0.0 if fits else float(time_s[0] - log_s[0])
    bins = _binned(time_s, heights_nm)
    if bins is None:
        return Offset(plain, 0.0, fits)
    at_s, heights = bins
    at_plain = _explained(log_s + plain, magnet, at_s, heights)
    least = COVERED_SHARE * min(lasts, logged)
    low = float(time_s[0] + least - log_s[-1])
    high = float(time_s[-1] - least - log_s[0])
    step = max(BIN_S, (high - low) / 3000)
    tried = np.arange(low, high + step, step)
    shares = np.array([_explained(log_s + one, magnet, at_s, heights) for one in tried])
    # equal steps of the magnets follow the heights as well one dwell apart, over fewer frames
    covered = shares * [np.mean(_inside(log_s + one, at_s)) for one in tried]
    at = int(np.argmax(covered))
    fine = np.arange(tried[at] - step, tried[at] + step, FINEST_S)
    fine_shares = np.array([_explained(log_s + one, magnet, at_s, heights) for one in fine])
    top = fine[fine_shares >= fine_shares.max() - 1e-3]
    best, share = float(np.mean(top)), float(fine_shares.max())
    if share < EXPLAINS or (fits and share < at_plain + WORTH_SHARE):
        return Offset(plain, at_plain, fits)
    other = _rival(covered, at)
    return Offset(round(best, 1), share, False, None if other is None else round(tried[other], 1))


def _rival(shares: FloatArray, best: int) -> int | None:
    """The best beyond what falls off about the best, if it is as good but for `ALIKE_SHARE`."""
    worse = np.flatnonzero(shares < shares[best] - WORTH_SHARE)
    low = max(worse[worse < best], default=0)
    high = min(worse[worse > best], default=len(shares))
    beyond = np.concatenate([shares[:low], np.zeros(high - low), shares[high:]])
    other = int(np.argmax(beyond))
    return other if beyond[other] > shares[best] - ALIKE_SHARE else None


def _binned(
    time_s: FloatArray, heights_nm: Sequence[FloatArray]
) -> tuple[FloatArray, list[FloatArray]] | None:
    """Times of bins and each bead's mean height in them, scaled to a variance of 1."""
    frame_s = float(np.median(np.diff(time_s)))
    rows = max(1, round(BIN_S / frame_s))
    count = len(time_s) // rows
    if count < 2 * LEVELS:
        return None
    at_s = time_s[: count * rows].reshape(count, rows).mean(axis=1)
    heights = []
    for z in heights_nm:
        pieces = z[: count * rows].reshape(count, rows)
        lost = ~np.isfinite(pieces)
        number = np.maximum(rows - lost.sum(axis=1), 1)
        mean = np.where(lost, 0.0, pieces).sum(axis=1) / number
        mean[lost.all(axis=1)] = np.nan
        # ranks: what the magnets do, however far beads jump when they are mistracked
        spread = np.nanstd(mean)
        if np.isfinite(spread) and spread > 0:
            order = np.argsort(np.argsort(np.where(np.isfinite(mean), mean, np.nanmedian(mean))))
            heights.append(np.asarray(order / len(order) - 0.5))
    return (at_s, heights) if heights else None


def _inside(log_s: FloatArray, at_s: FloatArray) -> NDArray[np.bool_]:
    """Which bins the log covers."""
    return np.asarray((at_s >= log_s[0]) & (at_s <= log_s[-1]))


def _explained(
    log_s: FloatArray, magnet: FloatArray, at_s: FloatArray, heights: Sequence[FloatArray]
) -> float:
    """The share of the heights' variance that the magnets' position explains, median over beads."""
    inside = _inside(log_s, at_s)
    if np.count_nonzero(inside) < 2 * LEVELS:
        return 0.0
    position = np.interp(at_s[inside], log_s, magnet)
    edges = np.unique(np.quantile(position, np.linspace(0, 1, LEVELS + 1)[1:-1]))
    level = np.searchsorted(edges, position)
    number = np.bincount(level)
    shares = []
    for height in heights:
        h = height[inside]
        means = np.bincount(level, h) / np.maximum(number, 1)
        total = float(np.var(h))
        shares.append(float(np.var(means[level]) / total) if total > 0 else 0.0)
    # share that chance explains with this number of levels
    chance = (len(edges) + 1) / len(position)
    return float(np.median(shares)) - chance
