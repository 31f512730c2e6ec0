"""What beads' motion says of them: which are fixed to the surface, and where the field points.

A bead on a tether fluctuates by tens of nm within a second, one that is fixed by its tracking noise
and what shakes the whole stage. Slow motion that beads share is the stage's and is taken off by
looking at stretches of a second only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtpipe.ground.types import FloatArray

WINDOW_S = 1.0
FEWEST_ROWS = 16
MOST_WINDOWS = 2000
# Quantile of the standard deviations of one-second stretches that stands for a bead. A high one is
# at low force, where tethered beads move most and references do not.
HIGH = 0.8
# References move by less than this part of what the typical tethered bead does.
FIXED_SHARE = 0.35
# Among fixed beads tracking noise differs by less than this.
FIXED_ALIKE = 3.0
# Least ratio of lateral variances that tells the field: across it the lever is longer by the
# radius, and the variance larger in proportion.
ACROSS_SHARE = 1.05


@dataclass(frozen=True)
class Motion:
    """How much a bead moves within a second, nm rms: laterally (or in z, where that is all)."""

    beads: dict[str, float]

    def of(self, beads: Sequence[str]) -> str:
        """Sizes of some beads in words."""
        sizes = sorted(self.beads[bead] for bead in beads)
        if round(sizes[0]) == round(sizes[-1]):
            return f"{sizes[0]:.3g} nm"
        return f"{sizes[0]:.3g} to {sizes[-1]:.3g} nm"


def motion_of(positions_nm: Mapping[str, FloatArray], rate_hz: float) -> Motion:
    """How much each bead moves.

    Parameters
    ----------
    positions_nm : (n_frames, 3) for each bead, NaN where lost.
    """
    width = max(FEWEST_ROWS, round(WINDOW_S * rate_hz))
    sizes = {}
    for bead, xyz in positions_nm.items():
        lateral = [s for axis in (0, 1) if np.isfinite(s := _size(xyz[:, axis], width))]
        if lateral:
            sizes[bead] = float(np.sqrt(np.mean(np.square(lateral))))
            continue
        # heights alone: what the magnets do to a bead is most of its motion
        z = xyz[:, 2][np.isfinite(xyz[:, 2])]
        sizes[bead] = float(np.subtract(*np.quantile(z, [0.95, 0.05]))) if len(z) else np.nan
    return Motion({bead: size for bead, size in sizes.items() if np.isfinite(size)})


def fixed_beads(motion: Motion) -> tuple[str, ...]:
    """Beads fixed to the surface: those that move far less than the others."""
    names = sorted(motion.beads, key=lambda bead: motion.beads[bead])
    sizes = [motion.beads[bead] for bead in names]
    if len(names) < 2:
        return ()
    for k in range(1, len(names)):
        typical = float(np.median(sizes[k:]))
        alike = sizes[k - 1] <= FIXED_ALIKE * float(np.median(sizes[:k]))
        if not alike:
            return ()
        if sizes[k - 1] < FIXED_SHARE * typical and sizes[k] > 2 * sizes[k - 1]:
            found = tuple(names[:k])
            return tuple(bead for bead in motion.beads if bead in found)
    return ()


def field_axis(positions_nm: Mapping[str, FloatArray], rate_hz: float) -> tuple[str, float] | None:
    """The axis along which tethered beads move less, and by which factor in variance.

    None where they do not agree, or move alike.
    """
    width = max(FEWEST_ROWS, round(WINDOW_S * rate_hz))
    ratios = []
    for xyz in positions_nm.values():
        x, y = _size(xyz[:, 0], width), _size(xyz[:, 1], width)
        if np.isfinite(x) and np.isfinite(y) and x > 0 and y > 0:
            ratios.append((y / x) ** 2)
    if not ratios:
        return None
    ratio = float(np.median(ratios))
    axis, factor = ("x", ratio) if ratio >= 1 else ("y", 1 / ratio)
    agree = np.mean([(one >= 1) == (ratio >= 1) for one in ratios])
    return (axis, factor) if factor > ACROSS_SHARE and agree > 0.7 else None


def _size(column: FloatArray, width: int) -> float:
    """Standard deviation about a straight line in stretches of `width` rows, a high one of them."""
    stretches = len(column) // width
    if stretches < 2:
        pieces = column[np.isfinite(column)][None, :]
    else:
        every = max(1, stretches // MOST_WINDOWS)
        pieces = column[: stretches * width].reshape(stretches, width)[::every]
        pieces = pieces[np.isfinite(pieces).all(axis=1)]
    if pieces.shape[0] == 0 or pieces.shape[1] < 4:
        return np.nan
    ramp = np.linspace(-1, 1, pieces.shape[1])
    ramp /= np.sqrt(ramp @ ramp)
    level = pieces - pieces.mean(axis=1, keepdims=True)
    level = level - np.outer(level @ ramp, ramp)
    return float(np.quantile(np.std(level, axis=1), HIGH))
