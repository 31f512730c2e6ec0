"""Looks at spectra: bands, narrow lines, what two axes or bead and reference have in common."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import special

from mtpipe.crosschecking.battery.observed import Fixed, Observed
from mtpipe.crosschecking.battery.statistic import Group, Kind, Statistic, Values
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import AXES

BANDS = 6
FEWEST_ORDINATES = 2.0
# Ordinates in a block whose median gives the local level; ordinates on each side of a found line
# that are left out for the second line (the taper spreads a line over three).
NEIGHBOURS, TAPERED = 96, 4
PAIRS = ((0, 1), (0, 2), (1, 2))


def band_edges_hz(seen: Sequence[Observed]) -> FloatArray:
    """Edges of the bands, logarithmic from the lowest frequency of the longest plateau."""
    low = min(float(s.data.spectrum.frequency_hz[0]) for s in seen)
    high = max(float(s.data.spectrum.frequency_hz[-1]) for s in seen)
    return np.geomspace(low * 0.99, high * 1.01, BANDS + 1)


def bands(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """Power in bands over its expectation, single plateaus and all together, in normal scores.

    The mean of n ordinates is a gamma variate, whose cube root is nearly normal (Wilson & Hilferty
    1931).
    """
    every = list(itertools.pairwise(fixed.band_edges_hz.tolist()))
    scores = [_band_scores(one, fixed.band_edges_hz) for one in seen]
    values: Values = []
    for axis, name in enumerate(AXES):
        for k, band in enumerate(every):
            each = {i: float(of[k][axis]) for i, of in enumerate(scores) if k in of}
            values += [
                (Statistic("psd_band", name, (i,), band), excess) for i, excess in each.items()
            ]
            if len(each) > 1:
                total = float(np.sum(list(each.values())) / np.sqrt(len(each)))
                values.append((Statistic("psd_band", name, tuple(each), band, pooled=True), total))
    return values


BANDS_OF_POWER = Group(
    bands,
    (Kind("psd_band", "", "power"),),
)


def _band_scores(one: Observed, edges_hz: FloatArray) -> dict[int, FloatArray]:
    """(3,) excess of a plateau's power in normal scores, by band; without bands that have next to
    no ordinates.
    """
    spectrum = one.data.spectrum
    ends = np.searchsorted(spectrum.frequency_hz, edges_hz).tolist()
    scores = {}
    for k, (low, high) in enumerate(itertools.pairwise(ends)):
        n = spectrum.ordinates[low:high]
        count = n.sum()
        if count >= FEWEST_ORDINATES:
            share = n @ one.ratio[low:high] / count
            scores[k] = 3 * np.sqrt(count) * (np.cbrt(share) - 1 + 1 / (9 * count))
    return scores


def lines(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """The two strongest single ordinates per axis and plateau, and the strongest of the mean.

    A line stands out of its neighbours, whatever the level of the spectrum there. In a plateau its
    value is a normal score, by the law of the largest of as many exponential variates as there are
    ordinates; in the mean it is ln of the power.
    """
    values: Values = []
    spectra = [one.whitened for one in seen]
    coarsest = max(float(s.frequency_hz[0]) for s in spectra)
    for axis, name in enumerate(AXES):
        cells: list[FloatArray] = []
        for i, spectrum in enumerate(spectra):
            power = np.abs(spectrum.bead[axis]) ** 2
            power /= local_level(power)
            left = power.copy()
            left[:3] = 0.0
            for statistic in ("line", "second_line"):
                at = int(np.argmax(left))
                frequency, width = spectrum.frequency_hz[at], 2 * spectrum.frequency_hz[0]
                band = (float(frequency - width), float(frequency + width))
                score = _score_of_largest(float(left[at]), len(power))
                values.append((Statistic(statistic, name, (i,), band), score))
                left[same_line(spectrum.frequency_hz, float(frequency))] = 0.0
                left[max(at - TAPERED, 0) : at + TAPERED + 1] = 0.0
            cell = np.floor(spectrum.frequency_hz / (2 * coarsest)).astype(int)
            cells.append(np.bincount(cell, power) / np.maximum(np.bincount(cell), 1))
        if len(seen) > 1:
            shortest = min(len(c) for c in cells)
            mean = np.mean([c[:shortest] for c in cells], axis=0)
            at = int(np.argmax(mean[2:])) + 2
            band = (2 * coarsest * at, 2 * coarsest * (at + 1))
            everywhere = tuple(range(len(seen)))
            entry = Statistic("line", name, everywhere, band, pooled=True)
            values.append((entry, float(np.log(mean[at]))))
    return values


NARROW_LINES = Group(
    lines,
    (
        Kind("line", "narrow lines", "the strongest narrow line", odd="large"),
        Kind("second_line", "narrow lines", "the second strongest narrow line", odd="large"),
    ),
)


def same_line(frequency_hz: FloatArray, line_hz: float) -> NDArray[np.bool_]:
    """Whether frequencies may be a line's own: mains and motors wander by as much."""
    return np.asarray(np.abs(frequency_hz - line_hz) <= 0.02 * line_hz + 0.1)


def local_level(power: FloatArray, neighbours: int = NEIGHBOURS) -> FloatArray:
    """(n,) mean of the ordinates about each, from their medians, which a line does not move."""
    blocks = max(len(power) // neighbours, 1)
    length = len(power) // blocks
    parts = power[: blocks * length].reshape(blocks, length)
    centre = (np.arange(blocks) + 0.5) * length
    level = np.median(parts, axis=1) / np.log(2)
    return np.asarray(np.interp(np.arange(len(power)), centre, np.maximum(level, 1e-12)))


def _score_of_largest(largest: float, count: int) -> float:
    """Normal score of the largest of `count` exponential variates of mean 1."""
    largest = max(largest, 0.1)
    log_p = np.log(count) - largest
    if largest < 30:
        log_p = np.log(-np.expm1(count * np.log1p(-np.exp(-largest))))
    return float(-special.ndtri_exp(min(log_p, -1e-12)))


def between_axes(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """In-phase correlation of two axes, slow and fast half of the information."""
    values: Values = []
    for a, b in PAIRS:
        pooled: list[float] = []
        for i, one in enumerate(seen):
            spectrum, model = one.data.spectrum, one.expected.power
            size = np.sqrt(model[:, a, a] * model[:, b, b])
            both = (spectrum.power[:, a, b] - model[:, a, b]) / size
            n = spectrum.ordinates
            weight = n * np.sqrt(_signal(one, a) * _signal(one, b))
            value = float(weight @ both / np.sqrt(np.sum(weight**2 / n) / 2))
            band = (float(spectrum.frequency_hz[0]), float(spectrum.frequency_hz[-1]))
            values.append((Statistic("correlation", AXES[a] + AXES[b], (i,), band), value))
            pooled.append(value)
        if len(pooled) > 1:
            entry = Statistic(
                "correlation", AXES[a] + AXES[b], tuple(range(len(seen))), pooled=True
            )
            values.append((entry, float(np.sum(pooled) / np.sqrt(len(pooled)))))
    return values


BETWEEN_AXES = Group(
    between_axes,
    (Kind("correlation", "correlation", "correlation of the two axes"),),
)


def _signal(one: Observed, axis: int) -> FloatArray:
    """Level of the spectrum over its highest level: emphasis on where the motion is."""
    return np.asarray(one.level[axis] / one.level[axis].max())


def with_reference(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """In-phase coherence of bead and reference, per axis, where the reference's own motion has not
    been subtracted from both.
    """
    values: Values = []
    for axis, name in enumerate(AXES):
        pooled: list[float] = []
        for i, one in enumerate(seen):
            spectrum = one.whitened
            inside = spectrum.frequency_hz >= fixed.above_hz[axis]
            if spectrum.reference is None or not inside.any():
                continue
            common = np.real(spectrum.bead[axis] * np.conj(spectrum.reference[axis]))
            value = float(common[inside].sum() / np.sqrt(inside.sum() / 2))
            ends = spectrum.frequency_hz[inside][[0, -1]]
            entry = Statistic("reference_coherence", name, (i,), (float(ends[0]), float(ends[1])))
            values.append((entry, value))
            pooled.append(value)
        if len(pooled) > 1:
            entry = Statistic("reference_coherence", name, tuple(range(len(seen))), pooled=True)
            values.append((entry, float(np.sum(pooled) / np.sqrt(len(pooled)))))
    return values


WITH_REFERENCE = Group(
    with_reference,
    (
        Kind(
            "reference_coherence",
            "reference motion",
            "correlation with the motion of the reference beads",
        ),
    ),
)
