"""Narrow lines in a bead's spectra: where they are, and bins of their own for them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from mtpipe.crosschecking.battery.observed import Observed, Whitened, whitened
from mtpipe.crosschecking.battery.spectral import NEIGHBOURS, local_level, same_line
from mtpipe.crosschecking.check import recorded_of
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.data import plateau_data
from mtpipe.joint_fit.fit import fit_configured
from mtpipe.recording.recording import AXES

MOST_LINES = 3
# The slowest ordinates hold drift.
SLOWEST = 3
# Frequencies searched per ordinate of the longest spectrum, and the points to each side of the best
# one at which the line is then placed exactly.
STEPS, FINER_STEPS = 2, 20
# Power of a steady sine wave in Hann-tapered ordinates, over amplitude² × duration, at its peak.
TAPERED_WAVE = 1 / 3
# Mean power of a wave whose phase diffuses, over amplitude²/width: of a²/2 in a Lorentzian peak
# (2 arctan 2 − ½ ln 5)/π, weighted with a triangle of the same width at half of its height.
DIFFUSING_WAVE = (2 * math.atan(2.0) - math.log(5.0) / 2) / (2 * math.pi)
# Each width that is searched is this many times the one before, up to a tenth of the frequency:
# what is wider has lost its phase within three periods and is no line.
WIDER, WIDEST = 4, 0.1
# Ordinates whose median is the level beside a peak, over those in the peak.
PEAKS_APART = 8
# Independent ordinates under a triangle, over those in its width: its weights are for 3/2 as many
# equal ones; Hann-tapered neighbours have much in common (Σw⁴/(Σw²)² of the taper); and the median
# that the mean is divided by has an error of its own.
TRIANGLE, HANN, MEDIAN = 3 / 2, 35 / 18, 1 / math.log(2) ** 2
INDEPENDENT = TRIANGLE / HANN / (1 + TRIANGLE * MEDIAN / PEAKS_APART)
# Number of tried amplitudes² of a line: from 0.1 of the local level to the largest ordinate itself.
SIZES = 16
LEAST_SEEN = 0.1


def with_lines_apart(case: PreparedBead) -> PreparedBead:
    """The case with bins of their own for lines that may be worth their numbers.

    A line has two numbers, frequency and size, which cost ln of the number of ordinates by BIC; a
    line that gains less gets no bin.
    """
    costs = math.log(case.fit.model.ordinates)
    return with_line_bins(case, tuple(hz for nats, hz in strongest_lines(case) if nats > costs))


def with_line_bins(case: PreparedBead, lines_hz: tuple[float, ...]) -> PreparedBead:
    """The bead with a narrow bin for each of these lines and for no other, fitted again."""
    if lines_hz == case.lines_hz:
        return case
    data = tuple(
        plateau_data(x, case.frame_s, phi, lines_hz)
        for x, phi in zip(case.positions_nm, case.phi, strict=True)
    )
    fit = fit_configured(replace(case.fit.model, data=data), case.fit.theta)
    return replace(case, lines_hz=lines_hz, fit=fit)


def distinct_lines(lines_hz: Sequence[float], known_hz: Sequence[float] = ()) -> tuple[float, ...]:
    """Lines without repetition: none is the same line as an earlier one, or as a known one."""
    kept: list[float] = []
    for line_hz in lines_hz:
        if not any(same_line(np.array(line_hz), other) for other in (*kept, *known_hz)):
            kept.append(line_hz)
    return tuple(kept)


def strongest_lines(case: PreparedBead) -> list[tuple[float, float]]:
    """The strongest lines, best first: ln likelihood gained (nats), and frequency.

    A wave has one amplitude per axis in all plateaus and stands out of its neighbours in the
    spectrum, whatever their level there; the axes' gains are summed. Where its phase diffuses, or
    jumps as frames are lost, its peak has a width. The first line is there always, be it chance or
    not.
    """
    seen = recorded_of(case)
    spectra = [whitened(one) for one in seen]
    first = max(SLOWEST * float(one.frequency_hz[0]) for one in spectra)
    last = min(float(one.frequency_hz[-1]) for one in spectra)
    finest = min(float(one.frequency_hz[0]) for one in spectra)
    step = finest / STEPS
    # the last one too: mains are often at half the frame rate
    frequency = np.arange(first + step, last + step, step)
    widths_hz = _widths_hz(finest, WIDEST * last)
    gains = np.array(
        [[_axis_gains(seen, spectra, a, frequency, w) for a in range(len(AXES))] for w in widths_hz]
    )
    # (widths, frequencies)
    total = np.where(widths_hz[:, None] < WIDEST * frequency, gains.sum(axis=1), 0.0)
    found: list[tuple[float, float]] = []
    while len(found) < MOST_LINES and total.max() > 0:
        of_width, at = np.unravel_index(np.argmax(total), total.shape)
        nats, line_hz = float(total[of_width, at]), float(frequency[at])
        if of_width == 0:
            line_hz = _exactly(case, int(np.argmax(gains[0, :, at])), line_hz, STEPS * step)
        found.append((nats, line_hz))
        # a wide peak beside it has the line itself within its width
        near = np.abs(frequency - line_hz) <= widths_hz[of_width] + widths_hz[:, None]
        total[same_line(frequency, line_hz) | near] = 0.0
    return found


def _widths_hz(finest_hz: float, widest_hz: float) -> FloatArray:
    """Widths of peaks that are searched: 0 of a steady wave, then from a few ordinates on."""
    count = max(math.ceil(math.log(widest_hz / finest_hz, WIDER)), 1)
    return np.array([0.0, *(finest_hz * WIDER**k for k in range(1, count))])


def _axis_gains(
    seen: Sequence[Observed],
    spectra: Sequence[Whitened],
    axis: int,
    frequency_hz: FloatArray,
    width_hz: float,
) -> FloatArray:
    """(frequencies,) ln likelihood that a wave of the best amplitude gains along one axis.

    Parameters
    ----------
    width_hz : of its peak, at half of its height; 0 of a steady wave.
    """
    over, wave, counts = [], [], []
    for one, spectrum in zip(seen, spectra, strict=True):
        power = np.abs(spectrum.bead[axis]) ** 2
        spacing_hz = float(spectrum.frequency_hz[0])
        # odd, so that what is smoothed stays where it is
        count = 2 * int(width_hz / spacing_hz / 2) + 1
        level = local_level(power, max(NEIGHBOURS, PEAKS_APART * count))
        nearest = np.rint(frequency_hz / spacing_hz).astype(int) - 1
        nearest = np.clip(nearest, 0, len(power) - 1)
        over.append(_under_triangle(power / level, count)[nearest])
        expected = np.interp(frequency_hz, one.data.spectrum.frequency_hz, one.level[axis])
        size = TAPERED_WAVE * one.duration_s if width_hz == 0 else DIFFUSING_WAVE / width_hz
        wave.append(size / (expected * level[nearest]))
        counts.append(max(INDEPENDENT * count, 1.0))
    return _gains(np.array(over), np.array(wave), np.array(counts))


def _under_triangle(ordinates: FloatArray, count: int) -> FloatArray:
    """(n,) means about each, weighted with a triangle that is `count` wide at half of its height;
    beyond both ends there is no line.
    """
    for _ in range(2):
        ordinates = uniform_filter1d(ordinates, count, mode="constant", cval=1.0)
    return ordinates


def _gains(over: FloatArray, wave: FloatArray, counts: FloatArray) -> FloatArray:
    """(frequencies,) ln likelihood that a wave of the best size gains in the plateaus together.

    Ordinates are exponential variates of mean 1 + a² wave, against mean 1.

    Parameters
    ----------
    over : (plateaus, frequencies) ordinates over their neighbours' level, means over the peak.
    wave : the same of a wave of 1 nm. counts : (plateaus,) independent ordinates in the peak.
    """
    low = LEAST_SEEN / wave.max(axis=0)
    high = np.maximum((over / wave).max(axis=0), 2 * low)
    best = np.zeros(over.shape[1])
    for square in np.geomspace(low, high, SIZES):
        raised = square * wave
        gain = over * raised / (1 + raised) - np.log1p(raised)
        best = np.maximum(best, counts @ gain)
    return np.asarray(best)


def _exactly(case: PreparedBead, axis: int, line_hz: float, within_hz: float) -> float:
    """Where a line is: at the peak of the plateaus' periodograms over what is expected beside it.

    Frequencies are finer than those of the spectrum, as the line leaks into its neighbours by how
    far it is from the nearest.
    """
    points = 2 * FINER_STEPS + 1
    frequency = line_hz + np.linspace(-within_hz, within_hz, points)
    total = np.zeros(points)
    for position, data, model in zip(
        case.positions_nm, case.fit.model.data, case.fit.expected, strict=True
    ):
        series = np.nan_to_num(position[:, axis] - np.nanmean(position[:, axis]))
        time_s = case.frame_s * np.arange(len(series))
        sums = np.array([np.exp(-2j * np.pi * f * time_s) @ series for f in frequency])
        expected = np.interp(line_hz, data.spectrum.frequency_hz, model.power[:, axis, axis])
        expected /= np.interp(line_hz, data.spectrum.frequency_hz, data.spectrum.gain(axis))
        total += np.abs(sums) ** 2 / (len(series) * expected)
    return float(frequency[np.argmax(total)])
