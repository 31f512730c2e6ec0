"""Low-pass of a series with gaps, and the cutoff that minimises the noise added.

A series is one axis on the camera's regular grid, NaN where it is lost. It is cut at long gaps
into stretches; each loses its straight line and is filtered in the cosine basis (DCT-II), whose
mirrored ends ring neither at the ends of the recording nor across gaps. White noise stays white in
that basis, and a random walk is exactly diagonal in it. The response is that of a second-order
Butterworth filter run forwards and backwards (zero phase, half amplitude at the cutoff), which is
also the penalised least-squares smoother of Garcia (2010, Comput. Stat. Data Anal. 54:1167), from
whom the treatment of missing values is taken.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct, next_fast_len

from mtpipe.ground.types import FloatArray

BINS_PER_OCTAVE = 24
GAP_PASSES = 4
# Drift is seen up to 3 times the cutoff frequency. A random walk leaves 1.66 times as much in all
# as up to there: the ratio of the integrals of u⁶/(1 + u⁴)² to infinity and to 3.
DRIFT_SEEN, LEFT_OF_WALK = 3.0, 1.66


@dataclass(frozen=True)
class PowerBins:
    """Squared cosine coefficients summed into bins of frequency.

    Attributes
    ----------
    frequency_hz : (n_bins,) middle of each bin.
    power_nm2 : (n_bins,) sum of squares (or of products of two series); white noise of variance
        s2 gives s2 per coefficient.
    count : (n_bins,) coefficients in each bin, at least 1.
    """

    frequency_hz: FloatArray
    power_nm2: FloatArray
    count: FloatArray


@dataclass(frozen=True)
class Cutoff:
    """The low-pass chosen: `cutoff_hz` None is no filter at all (frame by frame).

    `noise_added_nm` : root mean square of the reference's noise that passes. `start_stderr_nm` : of
    the drift at the series' first frame.
    """

    cutoff_hz: float | None
    noise_added_nm: float
    start_stderr_nm: float


def response(frequency_hz: FloatArray, cutoff_hz: float | None) -> FloatArray:
    """Amplitude response of the low-pass, 1 / (1 + (f/f_c)^4); 1 everywhere for None."""
    if cutoff_hz is None:
        return np.ones_like(frequency_hz)
    square = (frequency_hz / cutoff_hz) ** 2
    return np.asarray(1.0 / (1.0 + square * square))


def low_pass(series_nm: FloatArray, rate_hz: float, cutoff_hz: float | None) -> FloatArray:
    """Part of a series slower than the cutoff.

    Gaps of one frame, or of at most half a period of the cutoff, are bridged; longer ones stay NaN
    and cut the series, so that nothing rings across them. Without a cutoff the series itself is
    returned.

    Parameters
    ----------
    series_nm : (n,) on a regular grid, NaN where lost.
    rate_hz : frames per second.
    cutoff_hz : half-amplitude frequency, or None.

    Returns
    -------
    (n,) nm.
    """
    if cutoff_hz is None:
        return series_nm
    slow = np.full(len(series_nm), np.nan)
    longest_gap = max(1, int(rate_hz / (2 * cutoff_hz)))
    for start, stop in stretches(np.isfinite(series_nm), longest_gap):
        slow[start:stop] = _low_pass_stretch(series_nm[start:stop], rate_hz, cutoff_hz)
    return slow


def best_cutoff(bins: PowerBins, noise_nm2: FloatArray, white_nm: float) -> Cutoff:
    """Cutoff that minimises [drift left in the trace + reference noise carried into it].

    The expectation of (1 - h)^2 drift + h^2 noise over all coefficients is estimated without bias
    from the reference's own power, drift = power - noise (Stein 1981, Ann. Stat. 9:1135), so lines
    above the noise count as drift worth subtracting. Frame-by-frame subtraction and the lowest
    frequency of the recording are among the candidates.

    Parameters
    ----------
    bins : the combined reference's power.
    noise_nm2 : (n_bins,) variance of its noise per coefficient.
    white_nm : its white tracking noise per frame.
    """
    low, high = float(bins.frequency_hz[0]), float(bins.frequency_hz[-1])
    grid = np.geomspace(low, 4 * high, 1 + math.ceil(24 * math.log2(4 * high / low)))
    candidates: list[float | None] = [*grid.tolist(), None]
    gain = np.array([response(bins.frequency_hz, c) for c in candidates])
    noise = bins.count * noise_nm2
    cost = (1 - gain) ** 2 @ (bins.power_nm2 - noise) + gain**2 @ noise
    best = candidates[int(np.argmin(cost))]
    return at_cutoff(bins, noise_nm2, white_nm, best)


def at_cutoff(
    bins: PowerBins, noise_nm2: FloatArray, white_nm: float, cutoff_hz: float | None
) -> Cutoff:
    """What a low-pass lets through of the noise, and how well it knows where the series starts.

    Parameters as of `best_cutoff`. At an end all cosines are 1 and not 1/√2 as in the mean, so
    that the variance of what is left of the drift, and of the noise let through, is twice theirs.
    Without a filter a start is one frame, and as good as the noise of that.
    """
    passed_nm = passed_noise_nm(bins, white_nm, cutoff_hz)
    if cutoff_hz is None:
        return Cutoff(None, passed_nm, white_nm)
    gain = response(bins.frequency_hz, cutoff_hz)
    noise = bins.count * noise_nm2
    # farther up the drift drowns in the noise; what a random walk leaves there is added
    seen = bins.frequency_hz < DRIFT_SEEN * cutoff_hz
    left = max(0.0, float(((1 - gain) ** 2 * (bins.power_nm2 - noise))[seen].sum()))
    wrong = LEFT_OF_WALK * left + float(gain**2 @ noise)
    return Cutoff(cutoff_hz, passed_nm, math.sqrt(2 * wrong / float(bins.count.sum())))


def passed_noise_nm(bins: PowerBins, white_nm: float, cutoff_hz: float | None) -> float:
    """Root mean square of white noise after the low-pass, nm."""
    gain = response(bins.frequency_hz, cutoff_hz)
    return float(white_nm * np.sqrt(np.sum(gain**2 * bins.count) / np.sum(bins.count)))


def power_bins(
    pairs: Sequence[tuple[FloatArray, FloatArray]], rate_hz: float, edges_hz: FloatArray
) -> PowerBins:
    """Sum products of cosine coefficients into bins; bins without a coefficient are left out.

    Parameters
    ----------
    pairs : for each piece of the recording the coefficients of two series (twice the same one
        for its power), from `coefficients`.
    rate_hz : frames per second.
    edges_hz : (n_bins + 1,) increasing.
    """
    total = np.zeros(len(edges_hz) - 1)
    count = np.zeros(len(edges_hz) - 1)
    middle = np.zeros(len(edges_hz) - 1)
    for first, second in pairs:
        n = len(first)
        # Coefficient j has frequency j rate / 2n; j = 0 is the mean, already removed.
        index = np.clip(np.ceil(edges_hz * 2 * n / rate_hz).astype(np.int64), 1, n)
        sums = np.concatenate([[0.0], np.cumsum(first * second)])
        total += np.diff(sums[index])
        count += np.diff(index)
        middle += np.diff(index) * (index[1:] + index[:-1] - 1) * rate_hz / (4 * n)
    filled = count > 0
    return PowerBins(middle[filled] / count[filled], total[filled], count[filled])


def octave_edges_hz(lengths: Iterable[int], rate_hz: float) -> FloatArray:
    """Edges of logarithmic bins from the lowest frequency of the longest piece to Nyquist."""
    low, high = rate_hz / (2 * max(lengths)), rate_hz / 2
    n = max(2, math.ceil(BINS_PER_OCTAVE * math.log2(high / low)))
    edges = np.geomspace(low, high, n + 1)
    edges[[0, -1]] = low / 2, high * 1.001
    return edges


def coefficients(piece_nm: FloatArray) -> FloatArray:
    """Orthonormal cosine coefficients of a piece without its line; lost frames interpolated."""
    line = _line(piece_nm)
    rest = _interpolated(piece_nm - line)
    return np.asarray(dct(rest, norm="ortho"))


def stretches(known: NDArray[np.bool_], longest_gap: int) -> list[tuple[int, int]]:
    """Ranges [start, stop) that begin and end with known frames, cut at gaps that are too long."""
    if known.all():
        return [(0, len(known))] if len(known) else []
    rows = np.flatnonzero(known)
    if not len(rows):
        return []
    cut = np.flatnonzero(np.diff(rows) - 1 > longest_gap)
    starts = rows[np.concatenate([[0], cut + 1])]
    stops = rows[np.concatenate([cut, [len(rows) - 1]])] + 1
    return list(zip(starts.tolist(), stops.tolist(), strict=True))


def _low_pass_stretch(piece: FloatArray, rate_hz: float, cutoff_hz: float) -> FloatArray:
    n = len(piece)
    line = _line(piece)
    rest = piece - line
    lost = ~np.isfinite(rest)
    # Mirroring a few frames at the end makes the length a product of small primes: the transform
    # of 10 million frames of prime length takes twenty times longer.
    rest = np.pad(_interpolated(rest), (0, next_fast_len(n, real=True) - n), mode="symmetric")
    gain = _gain(len(rest), rate_hz, cutoff_hz)
    for _ in range(GAP_PASSES if lost.any() else 1):
        slow = idct(dct(rest, norm="ortho") * gain, norm="ortho")
        rest[:n][lost] = slow[:n][lost]
    return np.asarray(slow[:n] + line)


@functools.lru_cache(maxsize=4)
def _gain(frames: int, rate_hz: float, cutoff_hz: float) -> FloatArray:
    """(frames,) response at the frequencies of a cosine transform; kept for simulations."""
    return response(np.arange(frames) * rate_hz / (2 * frames), cutoff_hz)


def _line(piece: FloatArray) -> FloatArray:
    """Straight line through the known frames, by least squares."""
    n = len(piece)
    known = np.isfinite(piece)
    time = np.linspace(-1.0, 1.0, n) if n > 1 else np.zeros(1)
    t, y = (time, piece) if known.all() else (time[known], piece[known])
    middle, level = float(t.mean()), float(y.mean())
    t = t - middle
    slope = float(t @ (y - level)) / float(t @ t) if len(y) > 2 else 0.0
    time -= middle
    time *= slope
    time += level
    return time


def _interpolated(piece: FloatArray) -> FloatArray:
    known = np.isfinite(piece)
    if known.all():
        return piece
    rows = np.arange(len(piece))
    filled = piece.copy()
    filled[~known] = np.interp(rows[~known], rows[known], piece[known])
    return filled
