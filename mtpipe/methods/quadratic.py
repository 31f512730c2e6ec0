"""Mean squares of differences of a trace, and the exact covariance that such estimates have.

Every statistic here is the mean over time of the square of a short weighted sum (a stencil) of the
positions or of their running sum: the variance, the structure function ⟨(x_{t+l} − x_t)²⟩, Allan
and Hadamard variances. For a Gaussian process two such statistics have the covariance
2/(M_i M_j) Σ_{s,t} Γ_ij(t − s)², Γ_ij the covariance of the two weighted sums (Isserlis 1918).

Lost frames: each statistic is rewritten as a sum over lags of the structure function, taken over
the pairs of frames that are there (Mondal & Percival 2010, Ann. Inst. Stat. Math. 62:943). Its
expectation stays the same whichever frames are lost, as long as loss does not depend on position;
the covariance is then a trace of matrices, estimated with a few random probes (Hutchinson 1990).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, signal

from mtpipe.ground.types import FloatArray
from mtpipe.methods.motion import SeenMotion

# Beyond this many relaxation times a covariance (squared) is below 1e-8.
NEGLIGIBLE = 10.0
# Steps of the sum over lags per spacing of the shorter stencil; the error is below 1 %.
STEPS_PER_SPACING = 8
PROBES = 8


@dataclass(frozen=True)
class Stencil:
    """Weights of a difference: Σ coefficient · series[t + offset]; the first offset is 0."""

    offsets: tuple[int, ...]
    coefficients: tuple[float, ...]

    @property
    def span(self) -> int:
        """Frames from the first to the last offset."""
        return self.offsets[-1]

    @property
    def spacing(self) -> int:
        """Frames from the first to the second offset; 1 if there is no second."""
        return self.offsets[1] if len(self.offsets) > 1 else 1

    @property
    def sums_to_zero(self) -> bool:
        """Whether a constant series gives zero."""
        return abs(sum(self.coefficients)) < 1e-12

    def applied(self, series: FloatArray) -> FloatArray:
        """(len(series) − span,) weighted sums."""
        count = len(series) - self.span
        parts = zip(self.offsets, self.coefficients, strict=True)
        return np.asarray(sum(weight * series[at : at + count] for at, weight in parts))


@dataclass(frozen=True)
class QuadraticStatistics:
    """Statistics of one trace with their law under a model.

    Attributes
    ----------
    stencils : one per statistic. on_sums : they act on the running sum, not on the positions.
    expected : expectation of each statistic for a motion, (n,) nm².
    frames : length of the trace, lost frames included.
    values : (n,) nm², as measured.
    gaps : how lost frames enter, or None for a complete trace.
    """

    stencils: tuple[Stencil, ...]
    on_sums: bool
    expected: Callable[[SeenMotion], FloatArray]
    frames: int
    values: FloatArray
    gaps: Gaps | None

    def covariance(self, motion: SeenMotion) -> FloatArray:
        """(n, n) nm⁴, covariance of `values` if the motion is this one."""
        if self.gaps is not None:
            return self.gaps.covariance(motion)
        series = self.frames + 1 if self.on_sums else self.frames
        reach = int(NEGLIGIBLE * motion.tau_s / motion.camera.frame_s) + 2
        longest = max(stencil.span for stencil in self.stencils)
        size = min(series, longest + reach) + longest
        lag = np.arange(size + 1)
        if self.on_sums:
            # −½ of the variance of a sum of `lag` frames: what remains of the covariance of the
            # running sum once stencils that sum to zero have acted
            half = -0.5 * lag.astype(float) ** 2
            half[1:] *= motion.mean_variance(lag[1:])
        else:
            half = motion.lag_covariance(lag)
        kernel = np.concatenate([half[:0:-1], half])
        out = np.empty((len(self.stencils), len(self.stencils)))
        for i, first in enumerate(self.stencils):
            for j, second in enumerate(self.stencils[: i + 1]):
                out[i, j] = out[j, i] = _pair(first, second, kernel, series, reach)
        return out if self.on_sums else out - self._of_the_mean(motion)

    def _of_the_mean(self, motion: SeenMotion) -> FloatArray:
        """What subtracting the mean of a complete trace takes from the variance's covariances."""
        n = self.frames
        sums = np.cumsum(motion.lag_covariance(np.arange(n)))
        # covariance of each position with the sum of all
        rows = sums + sums[::-1] - sums[0]
        out = np.zeros((len(self.stencils), len(self.stencils)))
        for i, stencil in enumerate(self.stencils):
            for j, other in enumerate(self.stencils[: i + 1]):
                if not (stencil.sums_to_zero and other.sums_to_zero):
                    narrow = stencil if stencil.sums_to_zero else other
                    out[i, j] = out[j, i] = 2 * np.mean(narrow.applied(rows) ** 2) / n**2
            if not stencil.sums_to_zero:
                out[i, i] = 2 * out[i, i] - 2 * rows.sum() ** 2 / n**4
        return out


def _pair(first: Stencil, second: Stencil, kernel: FloatArray, series: int, reach: int) -> float:
    """2/(M₁M₂) Σ over lags of (pairs of windows at this lag) · Γ(lag)²."""
    windows, others = series - first.span, series - second.span
    stride = max(1, min(first.spacing, second.spacing) // STEPS_PER_SPACING)
    low = -stride * (min(windows - 1, second.span + reach) // stride)
    high = stride * (min(others - 1, first.span + reach) // stride)
    lag = np.arange(low, high + 1, stride)
    pairs = np.minimum(windows, others - lag) - np.maximum(0, -lag)
    centre = len(kernel) // 2
    cross = np.zeros(len(lag))
    for here, weight in zip(first.offsets, first.coefficients, strict=True):
        for there, other in zip(second.offsets, second.coefficients, strict=True):
            shift = centre + there - here
            cross += weight * other * kernel[shift + low : shift + high + 1 : stride]
    return 2 * stride * float(pairs @ cross**2) / (windows * others)


def statistics_of(
    x_nm: FloatArray,
    stencils: tuple[Stencil, ...],
    expected: Callable[[SeenMotion], FloatArray],
    *,
    on_sums: bool,
) -> QuadraticStatistics:
    """Measure the statistics of a trace, (n_frames,) nm with NaN where a frame is lost."""
    present = np.isfinite(x_nm)
    centred = np.where(present, x_nm - x_nm[present].mean(), 0.0)
    if not present.all():
        gaps = Gaps(present, stencils, on_sums)
        return QuadraticStatistics(
            stencils, on_sums, expected, len(x_nm), gaps.values(centred), gaps
        )
    series = np.concatenate([[0.0], np.cumsum(centred)]) if on_sums else centred
    values = np.array([np.mean(stencil.applied(series) ** 2) for stencil in stencils])
    return QuadraticStatistics(stencils, on_sums, expected, len(x_nm), values, None)


@dataclass(frozen=True, eq=False)
class Gaps:
    """The statistics as sums over pairs of the frames that are there.

    Each is x'Bx with B = diag(r) − T on these frames: T_{st} the weight of the pair's lag divided
    by the number of such pairs, r its row sums.
    """

    present: NDArray[np.bool_]
    stencils: tuple[Stencil, ...]
    on_sums: bool

    @functools.cached_property
    def padding(self) -> int:
        """Length at which a Fourier transform mixes no lags."""
        return fft.next_fast_len(2 * len(self.present), real=True)

    @functools.cached_property
    def pairs(self) -> FloatArray:
        """(frames,) number of pairs of present frames at each lag."""
        power = np.abs(fft.rfft(self.present.astype(float), self.padding)) ** 2
        return np.asarray(np.round(fft.irfft(power, self.padding)[: len(self.present)]))

    @functools.cached_property
    def transfer(self) -> list[FloatArray]:
        """For each statistic the Fourier transform of its weight per pair, even in the lag."""
        frames = len(self.present)
        out = []
        for stencil in self.stencils:
            weights = np.zeros(frames)
            if stencil.sums_to_zero:
                on_positions = np.zeros(stencil.span + 1)
                on_positions[list(stencil.offsets)] = stencil.coefficients
                if self.on_sums:
                    on_positions = -np.cumsum(on_positions)[:-1]
                lagged = signal.correlate(on_positions, on_positions)[len(on_positions) :]
                weights[1 : len(lagged) + 1] = -lagged
                weights /= np.maximum(self.pairs, 1)
            else:
                # the variance of the frames present: all pairs alike
                weights[1:] = 1 / self.pairs[0] ** 2
            even = np.zeros(self.padding)
            even[:frames] = weights
            even[-frames + 1 :] += weights[:0:-1]
            out.append(fft.rfft(even).real)
        return out

    def applied(self, transfer: FloatArray, u: FloatArray) -> FloatArray:
        """B u for one statistic, (frames,)."""
        return self.present * (self._rows(transfer) * u - self._smooth(transfer, self.present * u))

    def values(self, centred: FloatArray) -> FloatArray:
        """(n,) the statistics of a trace that is 0 where a frame is lost."""
        return np.array([centred @ self.applied(t, centred) for t in self.transfer])

    def covariance(self, motion: SeenMotion) -> FloatArray:
        """(n, n) 2 tr(B_i C B_j C), estimated with the same random probes at every call."""
        frames, size = len(self.present), self.padding
        lag = np.arange(size // 2 + 1)
        half = motion.lag_covariance(lag)
        even = np.concatenate([half, half[1 : size - size // 2][::-1]])
        root = np.sqrt(np.maximum(fft.rfft(even).real, 0.0))
        random = np.random.default_rng(0)
        out = np.zeros((len(self.stencils), len(self.stencils)))
        for _ in range(PROBES):
            probe = random.normal(size=size)
            u = fft.irfft(root * fft.rfft(probe), size)[:frames]
            rows = np.array(
                [fft.irfft(root * fft.rfft(self.applied(t, u), size), size) for t in self.transfer]
            )
            out += 2 * rows @ rows.T / PROBES
        return out

    def _smooth(self, transfer: FloatArray, u: FloatArray) -> FloatArray:
        smooth = fft.irfft(transfer * fft.rfft(u, self.padding), self.padding)
        return np.asarray(smooth[: len(self.present)])

    def _rows(self, transfer: FloatArray) -> FloatArray:
        return self._smooth(transfer, self.present.astype(float))
