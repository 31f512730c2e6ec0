"""Looks along time: drifts, steps and changes of mean and variance, quiet stretches, direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mtpipe.crosschecking.battery.observed import Fixed, Observed
from mtpipe.crosschecking.battery.statistic import Group, Kind, Statistic, Values
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import AXES
from mtpipe.spectra.correlation import lag_one_correlation

WINDOWS = 16
QUIET_S = 1.0


def over_time(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """All statistics along time, per axis and plateau, and the trends of all plateaus together."""
    values: Values = []
    pooled: dict[tuple[str, str], list[float]] = {}
    for i, one in enumerate(seen):
        series = one.bridged_nm
        frames = series.shape[1]
        means, logs = in_windows(one)
        quiet_length = min(max(4, round(QUIET_S / one.frame_s)), frames)
        pieces = frames // quiet_length
        short = series[:, : pieces * quiet_length].reshape(3, pieces, quiet_length)
        quiet = np.log(np.maximum(short.var(axis=2), 1e-12))
        edges = np.linspace(0.0, one.duration_s, WINDOWS + 1)
        spread = stderr_of_windows(one)
        trend, slope = _slope(means) / spread, _slope(logs)
        (walk, began), (change, changed) = _largest_step(means), _largest_step(logs)
        lowest, far = quiet.argmin(axis=1), np.abs(means).argmax(axis=1)
        for axis, name in enumerate(AXES):
            half = (float(edges[began[axis]]), float(edges[-1]))
            later = (float(edges[changed[axis]]), float(edges[-1]))
            window = (float(edges[far[axis]]), float(edges[far[axis] + 1]))
            second = int(lowest[axis]) * quiet_length * one.frame_s
            when = (second, second + quiet_length * one.frame_s)
            found = [
                (Statistic("mean_trend", name, (i,)), float(trend[axis])),
                (Statistic("mean_step", name, (i,), time_s=half), float(walk[axis] / spread[axis])),
                (Statistic("mean_excursion", name, (i,), time_s=window),
                 float(np.abs(means[axis, far[axis]]) / spread[axis])),
                (Statistic("variance_trend", name, (i,)), float(slope[axis])),
                (Statistic("variance_step", name, (i,), time_s=later), float(change[axis])),
                (Statistic("variance_spread", name, (i,)), float(logs[axis].std())),
                (Statistic("quietest_second", name, (i,), time_s=when),
                 float(quiet[axis, lowest[axis]] - np.median(quiet[axis]))),
            ]  # fmt: skip
            values += found
            for entry, value in found[:1] + found[3:4]:
                pooled.setdefault((entry.kind, name), []).append(value)
    everywhere = tuple(range(len(seen)))
    if len(seen) > 1:
        for (statistic, name), each in pooled.items():
            entry = Statistic(statistic, name, everywhere, pooled=True)
            values.append((entry, float(np.sum(each))))
    return values


OVER_TIME = Group(
    over_time,
    (
        Kind("mean_trend", "mean over time", "drift of the mean"),
        Kind("mean_step", "mean over time", "largest step of the mean", odd="large"),
        Kind("mean_excursion", "mean over time", "largest excursion of the mean", odd="large"),
        Kind("variance_trend", "variance over time", "trend of the variance"),
        Kind("variance_step", "variance over time", "largest step of the variance", odd="large"),
        Kind("variance_spread", "variance over time", "variation of the variance", odd="large"),
        Kind("quietest_second", "variance over time", "variance of the quietest second"),
    ),
)


def in_windows(one: Observed) -> tuple[FloatArray, FloatArray]:
    """(3, WINDOWS) means in nm about the plateau's, and ln of the variances in nm²."""
    series = one.bridged_nm
    length = series.shape[1] // WINDOWS
    blocks = series[:, : WINDOWS * length].reshape(3, WINDOWS, length)
    return blocks.mean(axis=2), np.log(np.maximum(blocks.var(axis=2), 1e-12))


def stderr_of_windows(one: Observed) -> FloatArray:
    """(3,) expected spread of window means: √(S(1/2T_w)/2T_w)."""
    window_s = len(one.position_nm) // WINDOWS * one.frame_s
    known_hz = one.data.spectrum.frequency_hz
    there = [np.interp(1 / (4 * window_s), known_hz, level) for level in one.level]
    return np.sqrt(np.array(there) / (2 * window_s))


def _slope(values: FloatArray) -> FloatArray:
    """(rows,) change from end to end of a straight line through the values (rows, n), over its own
    spread factor.
    """
    time = np.linspace(-1, 1, values.shape[1])
    return np.asarray(values @ time / np.sqrt(time @ time))


def _largest_step(values: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """(rows,) largest difference between the means before and after of values (rows, n), weighted
    for its spread, and where.
    """
    n = values.shape[1]
    before = np.arange(2, n - 1)
    sums = np.cumsum(values, axis=1)
    first = sums[:, before - 1]
    gap = (sums[:, -1:] - first) / (n - before) - first / before
    size = np.abs(gap * np.sqrt(before * (n - before) / n))
    return size.max(axis=1), before[size.argmax(axis=1)]


def irreversibility(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """⟨x²(t) x(t+m) − x(t) x²(t+m)⟩ at the lag of half decay; zero for reversible motion."""
    values: Values = []
    for i, one in enumerate(seen):
        series = one.bridged_nm
        # what bridges lost frames may lie far from the mean of those that are there
        series = series - series.mean(axis=1, keepdims=True)
        series = series / series.std(axis=1, keepdims=True)
        for axis, name in enumerate(AXES):
            x = series[axis]
            ratio = min(lag_one_correlation(x), 1 - 1e-6)
            lag = 1 if ratio < 0.5 else min(int(np.log(0.5) / np.log(ratio)) + 1, len(x) // 8)
            value = float(np.mean(x[lag:] * x[:-lag] * (x[:-lag] - x[lag:])))
            values.append((Statistic("irreversibility", name, (i,)), value))
    return values


IRREVERSIBILITY = Group(
    irreversibility,
    (
        Kind(
            "irreversibility", "time reversal", "difference between the trace and its time reversal"
        ),
    ),
)
