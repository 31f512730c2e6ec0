"""Which reference beads can be trusted, how noisy they are, and what they weigh.

A reference is left out when it jumps, moves on its own or is mostly lost. When every one does so,
those are kept that are not much worse than the best: subtracting them can add their faults to a
trace, but leaving all drift in every trace is worse, and own motion is counted as noise when the
low-pass is chosen. They are named with a warning.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtpipe.drift.combine import inverse_variance
from mtpipe.drift.faults import NO_JUMPS, Jumps, jumps_alone, jumps_among, mistracked
from mtpipe.drift.grid import Grid, piece_coefficients
from mtpipe.drift.noise import (
    OwnMotion,
    own_motion,
    white_noise_alone_nm,
    white_noise_shared_nm,
)
from mtpipe.ground.notice import Notice
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import AXES, Recording, ReferenceUse

MOSTLY_LOST = 0.3
# A bead is loose when the variance of its own motion exceeds 4 times that of its noise, 5 standard
# errors, and a fifth of the motion it shares (less may be a difference of scales).
LOOSE_NOISES = 4.0
LOOSE_SIGMA = 5.0
LOOSE_SHARE = 0.2
MISTRACKED_CAUTION = 0.01
MUCH_WORSE = 4.0


@dataclass(frozen=True)
class ReferenceAxis:
    """One axis of one reference: its series without mistracked frames, and what is known of it.

    `known` is the part of the recording's frames in which it is tracked.
    """

    series_nm: FloatArray
    known: float
    mistracked: NDArray[np.bool_]
    noise_nm: float
    own: OwnMotion
    jumps: Jumps

    @property
    def loose(self) -> bool:
        """Whether the bead moves on its own beside its tracking noise."""
        excess = self.own.variance_nm2 - self.noise_nm**2
        shared = self.own.total_nm2 - self.own.variance_nm2
        return bool(
            excess > LOOSE_NOISES * self.noise_nm**2
            and excess > LOOSE_SIGMA * self.own.stderr_nm2
            and excess > LOOSE_SHARE * shared
        )

    @property
    def own_share(self) -> float:
        """Part of the motion above the tracking noise that is the bead's own; 0 if not loose."""
        if not self.loose:
            return 0.0
        noise_nm2 = self.noise_nm**2
        moving = self.own.total_nm2 - noise_nm2
        return min(1.0, (self.own.variance_nm2 - noise_nm2) / moving) if moving > 0 else 1.0


@dataclass(frozen=True)
class Assessment:
    """All references of a recording: `axes[bead]` are its x, y, z."""

    axes: Mapping[str, tuple[ReferenceAxis, ReferenceAxis, ReferenceAxis]]
    uses: tuple[ReferenceUse, ...]
    notices: tuple[Notice, ...]


def assess(recording: Recording, grid: Grid) -> Assessment:
    """Examine every reference bead of a recording."""
    by_axis = [_assess_axis(recording, grid, axis) for axis in range(3)]
    axes = {bead: (by_axis[0][bead], by_axis[1][bead], by_axis[2][bead]) for bead in by_axis[0]}
    faults = {bead: _faults(bead, axes, recording, grid) for bead in axes}
    used = [bead for bead in axes if not faults[bead]]
    notices = [_mistracked_notice(bead, axes[bead]) for bead in axes]
    if axes and not used:
        unrest = {bead: _unrest(axes[bead]) for bead in axes}
        used = [b for b in axes if unrest[b] <= MUCH_WORSE * min(unrest.values())]
    for bead, sentences in faults.items():
        text = "; ".join(sentences)
        if sentences and bead in used:
            message = (
                f"Reference bead {bead} {text}. No reference bead is better, so it is subtracted "
                "all the same, and its own motion is in every trace."
            )
            notices.append(Notice("reference_moves", "warning", message, bead))
        elif sentences:
            message = f"Reference bead {bead} is left out: it {text}."
            notices.append(Notice("reference_left_out", "caution", message, bead))
    weights = _weights(axes, used)
    uses = tuple(
        ReferenceUse(
            bead,
            any(weights[bead]),
            weights[bead],
            _three([a.noise_nm for a in axes[bead]]),
            "; ".join(faults[bead]),
            any(axis.loose for axis in axes[bead]),
        )
        for bead in axes
    )
    return Assessment(axes, uses, tuple(n for n in notices if n is not None))


def _assess_axis(recording: Recording, grid: Grid, axis: int) -> dict[str, ReferenceAxis]:
    series = {b: grid.series_nm(recording, b, axis) for b in recording.references}
    for y in series.values():
        if np.fmax.reduce(y) == np.fmin.reduce(y):
            y[:] = np.nan  # A placeholder: no tracker gives one value throughout.
    whole = [b for b, y in series.items() if _known(y, grid) >= 1 - MOSTLY_LOST]
    alone = len(whole) < 2
    tethered = [grid.series_nm(recording, b, axis) for b in recording.tethered] if alone else []
    wrong: dict[str, NDArray[np.bool_]] = {}
    for bead, y in series.items():
        others = [series[b] for b in whole if b != bead]
        wrong[bead] = mistracked(y, others or tethered, grid.rate_hz)
    for bead, y in series.items():
        y[wrong[bead]] = np.nan
    return {
        bead: _assess_series(
            y, [series[b] for b in whole if b != bead], tethered, wrong[bead], grid
        )
        for bead, y in series.items()
    }


def _assess_series(
    y: FloatArray,
    others: Sequence[FloatArray],
    tethered: Sequence[FloatArray],
    wrong: NDArray[np.bool_],
    grid: Grid,
) -> ReferenceAxis:
    rate_hz, share = grid.rate_hz, _known(y, grid)
    known = np.isfinite(y)
    common = np.logical_and.reduce([known, *(np.isfinite(o) for o in others)])
    pieces = grid.known_pieces(common)
    if not pieces:
        others, common, pieces = [], known, grid.known_pieces(known)
    if not pieces:
        unknown = OwnMotion(math.nan, math.inf, math.nan)
        return ReferenceAxis(y, share, wrong, math.nan, unknown, NO_JUMPS)
    # Interpolated frames are the same in all, so that what is shared stays shared.
    own = piece_coefficients(y, pieces, common)
    beside = [piece_coefficients(o, pieces, common) for o in (others or tethered)]
    if others:
        noise_nm = white_noise_shared_nm([own, *beside], rate_hz)
        jumps = jumps_among(y, others, pieces, rate_hz, noise_nm)
    else:
        noise_nm = white_noise_alone_nm(own, rate_hz)
        jumps = jumps_alone(y, tethered, pieces, rate_hz, noise_nm)
    motion = own_motion(own, beside, rate_hz)
    return ReferenceAxis(y, share, wrong, noise_nm, motion, jumps)


def _known(series: FloatArray, grid: Grid) -> float:
    return float(np.mean(np.isfinite(series[grid.row])))


def _faults(
    bead: str,
    axes: Mapping[str, tuple[ReferenceAxis, ReferenceAxis, ReferenceAxis]],
    recording: Recording,
    grid: Grid,
) -> list[str]:
    sentences = []
    for name, axis in zip(AXES, axes[bead], strict=True):
        recorded = any(math.isfinite(a[AXES.index(name)].noise_nm) for a in axes.values())
        if recorded and axis.known < 1 - MOSTLY_LOST:
            sentences.append(f"is lost along {name} in {1 - axis.known:.0%} of the frames")
        if axis.jumps.number:
            at = int(np.searchsorted(grid.row, axis.jumps.first))
            times = "once" if axis.jumps.number == 1 else f"{axis.jumps.number} times"
            sentences.append(
                f"jumps {times} along {name}, first at {recording.time_s[at]:.1f} s, "
                f"by up to {axis.jumps.largest_nm:.3g} nm"
            )
        if axis.loose:
            moves = math.sqrt(axis.own.variance_nm2 - axis.noise_nm**2)
            sentences.append(
                f"moves on its own by {moves:.3g} nm rms along {name} (loosely attached)"
            )
    return sentences


def _unrest(axes: Sequence[ReferenceAxis]) -> float:
    """Own motion and jumps of a faulty reference in one number, for comparison only."""
    total = 0.0
    for axis in axes:
        if math.isnan(axis.noise_nm):
            continue
        if axis.known < 1 - MOSTLY_LOST:
            return math.inf
        excess_nm2 = axis.own.variance_nm2 - axis.noise_nm**2 if axis.loose else 0.0
        total += axis.jumps.total_nm2 + len(axis.series_nm) * excess_nm2
    return total


def _weights(
    axes: Mapping[str, tuple[ReferenceAxis, ReferenceAxis, ReferenceAxis]], used: Sequence[str]
) -> dict[str, tuple[float, float, float]]:
    table = {bead: [0.0, 0.0, 0.0] for bead in axes}
    for axis in range(3):
        tracked = [b for b in used if math.isfinite(axes[b][axis].noise_nm)]
        noise = np.array([axes[b][axis].noise_nm for b in tracked])
        for bead, weight in zip(tracked, inverse_variance(noise), strict=True):
            table[bead][axis] = float(weight)
    return {bead: _three(w) for bead, w in table.items()}


def _mistracked_notice(bead: str, axes: Sequence[ReferenceAxis]) -> Notice | None:
    number = int(np.sum(np.logical_or.reduce([a.mistracked for a in axes])))
    if not number:
        return None
    share = number / len(axes[0].mistracked)
    return Notice(
        "reference_mistracked",
        "caution" if share > MISTRACKED_CAUTION else "info",
        f"Reference bead {bead} was mistracked in {number} frames ({share:.2%}), which are left "
        "out of the drift.",
        bead,
    )


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = values
    return (x, y, z)
