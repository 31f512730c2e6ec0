"""Noise of reference beads: white tracking noise, and motion of their own beside it.

All estimates work on cosine coefficients of the plateaus (`lowpass.coefficients`), where white
noise has the same variance in every coefficient. What two beads share is the stage: the product
of a bead's coefficient with the difference to a witness has the bead's own variance as its mean,
whatever the witness's own motion is (the three-cornered hat of Gray & Allan 1974, Proc. 28th Freq.
Control Symp.:243, for two beads). A lone reference has its tethered neighbours as witnesses; they
are too noisy to give its white noise, which is then the floor of its own spectrum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import nnls

from mtpipe.drift.lowpass import power_bins
from mtpipe.recording import FloatArray

# White noise is read above this part of the Nyquist frequency; own motion above OWN_MOTION_HZ,
# below which stuck beads too wander apart by temperature and rotation of the field of view.
WHITE_FROM_NYQUIST = 0.1
OWN_MOTION_HZ = 0.5
FLOOR_BINS = 400
COEFFICIENTS_PER_BIN = 32
NEIGHBOURS = 15
OUTLIER_SIGMA = 5.0
FIT_PASSES = 6


@dataclass(frozen=True)
class OwnMotion:
    """Variance of a bead above 0.5 Hz that its witnesses do not share, white noise included."""

    variance_nm2: float
    stderr_nm2: float
    total_nm2: float


def white_noise_alone_nm(coefficients_nm: Sequence[FloatArray], rate_hz: float) -> float:
    """White noise of a lone reference: the floor of its spectrum beside random-walk drift.

    The floor and the tail of a random walk, a / (4 sin^2(pi f / rate)), are fitted to the upper
    nine tenths of the spectrum; bins that stand out (lines) are left out. The exposure blurs the
    walk within a frame, which takes a W/(6 D) off the floor (exposure W, frame time D); this is
    not corrected, as a stage is no random walk on the scale of a frame.

    Parameters
    ----------
    coefficients_nm : for each plateau, (n,) nm.
    rate_hz : frames per second.
    """
    edges = _white_edges_hz(coefficients_nm, rate_hz)
    bins = power_bins([(c, c) for c in coefficients_nm], rate_hz, edges)
    power, count = bins.power_nm2 / bins.count, bins.count
    theta = 2 * np.pi * bins.frequency_hz / rate_hz
    shapes = np.column_stack([np.ones_like(theta), 1 / (4 * np.sin(theta / 2) ** 2)])
    # A line stands out from its neighbours, whatever the fit; random-walk drift does not.
    near = median_filter(power, NEIGHBOURS, mode="nearest")
    usual = power < near * (1 + OUTLIER_SIGMA * np.sqrt(2 / count))
    model = near
    for _ in range(FIT_PASSES):
        weight = np.sqrt(count[usual]) / model[usual]
        share, _ = nnls(shapes[usual] * weight[:, None], power[usual] * weight)
        model = np.maximum(shapes @ share, near / 10)
    return math.sqrt(share[0])


def white_noise_shared_nm(coefficients_nm: Sequence[Sequence[FloatArray]], rate_hz: float) -> float:
    """White noise of a reference that has others beside it.

    Parameters
    ----------
    coefficients_nm : first the bead's, then each other reference's coefficients, plateau by
        plateau.
    """
    own, *others = coefficients_nm
    witness = [np.mean(pieces, axis=0) for pieces in zip(*others, strict=True)]
    pairs = [(c, c - w) for c, w in zip(own, witness, strict=True)]
    bins = power_bins(pairs, rate_hz, _white_edges_hz(own, rate_hz))
    # The median over bins passes over lines, which beads of different scale do not quite share.
    return math.sqrt(max(float(np.median(bins.power_nm2 / bins.count)), 0.0))


def own_motion(
    coefficients_nm: Sequence[FloatArray],
    witnesses_nm: Sequence[Sequence[FloatArray]],
    rate_hz: float,
) -> OwnMotion:
    """Variance above 0.5 Hz that is not shared with the witnesses.

    Every witness × plateau gives an unbiased value; they are weighted by their scatter.

    Parameters
    ----------
    coefficients_nm : for each plateau, (n,) nm.
    witnesses_nm : the same of every witness.
    """
    values, variances, totals = [], [], []
    for witness in witnesses_nm:
        for c, w in zip(coefficients_nm, witness, strict=True):
            first = max(1, math.ceil(OWN_MOTION_HZ * 2 * len(c) / rate_hz))
            c, w = c[first:], w[first:]
            if len(c) < COEFFICIENTS_PER_BIN or not np.isfinite(w).all():
                continue
            values.append(float(np.mean(c * (c - w))))
            variances.append(float(np.sum((c * w) ** 2)) / len(c) ** 2)
            totals.append(float(np.mean(c**2)))
    if not values:
        return OwnMotion(math.nan, math.inf, math.nan)
    weight = 1 / np.maximum(variances, 1e-300)
    mean = float(np.sum(weight * values) / np.sum(weight))
    total = float(np.sum(weight * totals) / np.sum(weight))
    return OwnMotion(mean, float(1 / np.sqrt(np.sum(weight))), total)


def _white_edges_hz(coefficients_nm: Sequence[FloatArray], rate_hz: float) -> FloatArray:
    longest = max(len(c) for c in coefficients_nm)
    total = sum(len(c) for c in coefficients_nm)
    n = int(np.clip(total // COEFFICIENTS_PER_BIN, 4, min(FLOOR_BINS, longest)))
    return np.linspace(WHITE_FROM_NYQUIST * rate_hz / 2, rate_hz / 2, n + 1)
