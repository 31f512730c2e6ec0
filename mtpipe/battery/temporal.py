"""Looks along time: drifts, steps and changes of mean and variance, quiet stretches, direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtpipe.battery.look import Look, Values
from mtpipe.battery.observed import Observed
from mtpipe.physics.camera import FloatArray
from mtpipe.recording import AXES

WINDOWS = 16
QUIET_S = 1.0


def over_time(seen: Sequence[Observed]) -> Values:
    """All looks along time, per axis and plateau, and the trends of all plateaus together."""
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
        for axis, name in enumerate(AXES):
            spread = stderr_of_window(one, axis)
            trend = _slope(means[axis]) / spread
            walk, at = _largest_step(means[axis])
            half = (float(edges[at]), float(edges[-1]))
            change, changed = _largest_step(logs[axis])
            lowest = int(np.argmin(quiet[axis]))
            when = (lowest * quiet_length * one.frame_s, (lowest + 1) * quiet_length * one.frame_s)
            far = int(np.argmax(np.abs(means[axis])))
            window = (float(edges[far]), float(edges[far + 1]))
            later = (float(edges[changed]), float(edges[-1]))
            found = [
                (Look("mean_trend", name, (i,)), trend),
                (Look("mean_step", name, (i,), time_s=half), walk / spread),
                (Look("mean_excursion", name, (i,), time_s=window),
                 float(np.max(np.abs(means[axis]))) / spread),
                (Look("variance_trend", name, (i,)), _slope(logs[axis])),
                (Look("variance_step", name, (i,), time_s=later), change),
                (Look("variance_spread", name, (i,)), float(logs[axis].std())),
                (Look("quietest_second", name, (i,), time_s=when),
                 float(quiet[axis, lowest] - np.median(quiet[axis]))),
            ]  # fmt: skip
            values += found
            for look, value in found[:1] + found[3:4]:
                pooled.setdefault((look.statistic, name), []).append(value)
    everywhere = tuple(range(len(seen)))
    if len(seen) > 1:
        for (statistic, name), each in pooled.items():
            look = Look(statistic, name, everywhere, pooled=True)
            values.append((look, float(np.sum(each))))
    return values


def in_windows(one: Observed) -> tuple[FloatArray, FloatArray]:
    """(3, WINDOWS) means in nm about the plateau's, and ln of the variances in nm²."""
    series = one.bridged_nm
    length = series.shape[1] // WINDOWS
    blocks = series[:, : WINDOWS * length].reshape(3, WINDOWS, length)
    return blocks.mean(axis=2), np.log(np.maximum(blocks.var(axis=2), 1e-12))


def stderr_of_window(one: Observed, axis: int) -> float:
    """Expected spread of window means: √(S(1/2T_w)/2T_w)."""
    spectrum = one.data.spectrum
    window_s = len(one.position_nm) // WINDOWS * one.frame_s
    level = one.expected.power[:, axis, axis] / spectrum.gain(axis)
    there = np.interp(1 / (4 * window_s), spectrum.frequency_hz, level)
    return float(np.sqrt(there / (2 * window_s)))


def _slope(values: FloatArray) -> float:
    """Change from end to end of a straight line through the values, over its own spread factor."""
    time = np.linspace(-1, 1, len(values))
    return float(time @ values / np.sqrt(time @ time))


def _largest_step(values: FloatArray) -> tuple[float, int]:
    """Largest difference between the means before and after, weighted for its spread, and where."""
    n = len(values)
    before = np.arange(2, n - 1)
    sums = np.cumsum(values)
    gap = (sums[-1] - sums[before - 1]) / (n - before) - sums[before - 1] / before
    size = gap * np.sqrt(before * (n - before) / n)
    at = int(np.argmax(np.abs(size)))
    return float(np.abs(size[at])), int(before[at])


def irreversibility(seen: Sequence[Observed]) -> Values:
    """⟨x²(t) x(t+m) − x(t) x²(t+m)⟩ at the lag of half decay; zero for reversible motion."""
    values: Values = []
    for i, one in enumerate(seen):
        series = one.bridged_nm
        # what bridges lost frames may lie far from the mean of those that are there
        series = series - series.mean(axis=1, keepdims=True)
        series = series / series.std(axis=1, keepdims=True)
        for axis, name in enumerate(AXES):
            x = series[axis]
            # of a slow trace the estimate may exceed 1
            ratio = min(float(np.mean(x[1:] * x[:-1])), 1 - 1e-6)
            lag = 1 if ratio < 0.5 else min(int(np.log(0.5) / np.log(ratio)) + 1, len(x) // 8)
            value = float(np.mean(x[lag:] * x[:-lag] * (x[:-lag] - x[lag:])))
            values.append((Look("irreversibility", name, (i,)), value))
    return values
