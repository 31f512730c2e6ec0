"""Curves of a recording beside those of its simulated counterparts: for the eye, not for p-values.

Per plateau and axis the spectrum, the distribution of positions and the Allan variance, each on a
grid that the recording sets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtpipe.crosschecking.battery.observed import Observed
from mtpipe.ground.types import FloatArray

Kind = Literal["spectrum", "histogram", "allan"]
KINDS: tuple[Kind, ...] = ("spectrum", "histogram", "allan")
ENVELOPE = (0.025, 0.5, 0.975)
HISTOGRAM_BINS, HISTOGRAM_SPREADS = 36, 4.5
FEWEST_BLOCKS = 8


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve of one trace.

    Attributes
    ----------
    plateau, axis : index of the plateau, and 0 to 2.
    at : (n,) frequencies in Hz, deviations from the mean in nm, or averaging times in s.
    recorded : (n,) nm²/Hz, 1/nm or nm².
    low, median, high : (n,) of the simulations, 2.5, 50 and 97.5 %.
    """

    kind: Kind
    plateau: int
    axis: int
    at: FloatArray
    recorded: FloatArray
    low: FloatArray
    median: FloatArray
    high: FloatArray


class CurveSet:
    """Collects the curves of simulations on the grids of a recording."""

    def __init__(self, recorded: Sequence[Observed]) -> None:
        self._edges_nm = [_histogram_edges_nm(one) for one in recorded]
        self._recorded = self.values(recorded)
        self._at = [
            at
            for one, edges in zip(recorded, self._edges_nm, strict=True)
            for axis in range(3)
            for at in (
                one.data.spectrum.frequency_hz,
                (edges[axis][1:] + edges[axis][:-1]) / 2,
                _averaged_frames(one) * one.frame_s,
            )
        ]
        self._simulated: list[list[FloatArray]] = []

    def add(self, values: list[FloatArray]) -> None:
        """Take in the values of one simulation."""
        self._simulated.append(values)

    def curves(self) -> tuple[Curve, ...]:
        """All curves, with what the simulations span."""
        found = []
        for number, (at, recorded) in enumerate(zip(self._at, self._recorded, strict=True)):
            trace, kind = divmod(number, len(KINDS))
            plateau, axis = divmod(trace, 3)
            each = np.array([values[number] for values in self._simulated])
            low, median, high = np.quantile(each, ENVELOPE, axis=0)
            found.append(Curve(KINDS[kind], plateau, axis, at, recorded, low, median, high))
        return tuple(found)

    def values(self, seen: Sequence[Observed]) -> list[FloatArray]:
        """Values of the curves of a simulation, per plateau, axis and kind."""
        values: list[FloatArray] = []
        for one, edges in zip(seen, self._edges_nm, strict=True):
            allan = _allan_nm2(one)
            spectrum = one.data.spectrum
            for axis in range(3):
                values.append(spectrum.power[:, axis, axis] / spectrum.gain(axis))
                there = one.position_nm[:, axis]
                there = there[np.isfinite(there)]
                counts = np.histogram(there - there.mean(), edges[axis])[0]
                values.append(counts / (len(there) * np.diff(edges[axis])))
                values.append(allan[axis])
        return values


def _histogram_edges_nm(one: Observed) -> FloatArray:
    """(3, bins + 1) edges about the mean of each axis."""
    spread = np.nanstd(one.position_nm, axis=0)[:, None]
    return np.asarray(HISTOGRAM_SPREADS * spread * np.linspace(-1, 1, HISTOGRAM_BINS + 1))


def _averaged_frames(one: Observed) -> FloatArray:
    """Powers of two, as far as enough blocks are there."""
    doublings = int(np.log2(max(len(one.position_nm) // FEWEST_BLOCKS, 1)))
    return np.asarray(2.0 ** np.arange(doublings + 1))


def _allan_nm2(one: Observed) -> FloatArray:
    """(3, times) Allan variance of the means over `_averaged_frames`."""
    means = one.bridged_nm
    found = []
    for _ in _averaged_frames(one):
        found.append(0.5 * np.mean(np.diff(means) ** 2, axis=1))
        pairs = means.shape[1] // 2
        means = means[:, : 2 * pairs].reshape(3, pairs, 2).mean(axis=2)
    return np.array(found).T
