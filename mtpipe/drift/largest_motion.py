"""How far reference beads can move by themselves: their own traces have all of that motion.

The stage's motion and tracking noise are in those traces too, so at every frequency their power is
at least that of the references' own motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from mtpipe.drift.lowpass import PowerBins, coefficients, power_bins
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera, power_spectrum

BINS_PER_OCTAVE = 3
# Fewer coefficients leave the power of a bin too uncertain.
FEWEST_COEFFICIENTS = 20
# Probability that a bin has by chance less power than is taken for possible.
UNLIKELY = 1e-3
# Variance in nm² of what no trace shows, and of what a trace without motion shows.
ANYTHING_NM2, NOTHING_NM2 = 1e12, 1e-6
# Relaxation times in s, from faster than any frame to longer than plateaus.
RELAXATIONS_S = np.geomspace(1e-3, 1e3, 121)


@dataclass(frozen=True, eq=False)
class LargestMotion:
    """Largest variance of relaxing motion of the references' mean: (3, relaxation times) in nm²."""

    nm2: FloatArray

    def at(self, axis: int, relaxation_s: float) -> float:
        """Along an axis, of motion that relaxes within a time, in nm²."""
        ln_nm2 = np.interp(np.log(relaxation_s), np.log(RELAXATIONS_S), np.log(self.nm2[axis]))
        return float(np.exp(ln_nm2))


def largest_motion(references_nm: Sequence[FloatArray], camera: Camera) -> LargestMotion:
    """How far the references can move by themselves.

    Parameters
    ----------
    references_nm : mean of the references in each plateau (n, 3), nothing subtracted, NaN where
        lost.
    """
    found = np.full((3, len(RELAXATIONS_S)), ANYTHING_NM2)
    for axis in range(3):
        pieces = [_known(one[:, axis]) for one in references_nm]
        bins = _power([one for one in pieces if len(one) > FEWEST_COEFFICIENTS], camera)
        if bins is None:
            continue
        per_nm2 = power_spectrum(bins.frequency_hz, 1.0, RELAXATIONS_S[:, None], camera)
        most = bins.power_nm2 / stats.chi2.ppf(UNLIKELY, bins.count)
        # white noise of 1 nm² has a power of 2 frame_s, and coefficients of 1 nm²
        found[axis] = np.min(2 * camera.frame_s * most / per_nm2, axis=1)
    return LargestMotion(np.clip(found, NOTHING_NM2, ANYTHING_NM2))


def _known(series_nm: FloatArray) -> FloatArray:
    """From the first to the last known frame."""
    known = np.flatnonzero(np.isfinite(series_nm))
    return series_nm[known[0] : known[-1] + 1] if len(known) else series_nm[:0]


def _power(pieces_nm: Sequence[FloatArray], camera: Camera) -> PowerBins | None:
    """Power of pieces, in bins that have enough coefficients; None where none has."""
    if not pieces_nm:
        return None
    rate_hz = 1 / camera.frame_s
    low, high = rate_hz / max(map(len, pieces_nm)), rate_hz / 2
    edges = np.geomspace(low, high, max(2, round(BINS_PER_OCTAVE * np.log2(high / low)) + 1))
    each = [coefficients(one) for one in pieces_nm]
    bins = power_bins([(one, one) for one in each], rate_hz, edges)
    enough = bins.count >= FEWEST_COEFFICIENTS
    if not enough.any():
        return None
    # lost frames are bridged, which takes up to their share of the power away
    known = float(np.mean(np.isfinite(np.concatenate(pieces_nm))))
    power = bins.power_nm2[enough] / known
    return PowerBins(bins.frequency_hz[enough], power, bins.count[enough])
